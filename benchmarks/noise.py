"""Microseconds per draw of each noise model's log-likelihood, and of celerite2's.

Run: python benchmarks/noise.py [--draws 64] [--repeats 15]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from deabayes.noise import REGISTRY

POINTS = (600, 5000, 50000)
LARGEST_RESIDUALS = 4_000_000
SPECIFIED = {600: 2.3, 5000: 26.0, 50000: 152.0}
"""Of the prototype the project started from, Ornstein-Uhlenbeck plus white."""


def best_time(call: Callable[[], object], repeats: int) -> float:
    """The shortest of `repeats` runs after a first one, in seconds."""
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def grids(points: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A regular grid, one whose spacing doubles seven times, and a random one."""
    doubling = np.repeat(0.25 * 2.0 ** np.arange(8), -(-points // 8))[:points]
    return {
        "regular": 0.1 * np.arange(points),
        "doubling": np.cumsum(doubling),
        "random": np.sort(rng.uniform(0.0, 0.1 * points, points)),
    }


def make_draws(name: str, size: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draws of a model's parameters near 1 (correlation times near 10)."""
    middles = {"s": 10.0, "1": 1.0}
    return {
        p.name: middles[p.unit] * np.exp(rng.normal(0.0, 0.3, size))
        for p in REGISTRY[name]().parameters("1", 1.0, 100.0)
    }


def celerite2_time(coordinate: np.ndarray, residual: np.ndarray, repeats: int) -> float | None:
    """Seconds for one draw by celerite2, None where it is not installed."""
    try:
        import celerite2
    except ImportError:
        return None

    def log_likelihood() -> float:
        process = celerite2.GaussianProcess(celerite2.terms.RealTerm(a=1.0, c=0.1))
        process.compute(coordinate, diag=np.ones(coordinate.size))
        return process.log_likelihood(residual)

    return best_time(log_likelihood, repeats)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=15)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    print("model,grid,points,draws,microseconds_per_draw,specified")
    for points in POINTS:
        size = max(1, min(options.draws, LARGEST_RESIDUALS // points))
        residuals, weights = rng.normal(size=(size, points)), np.ones(points)
        for grid, coordinate in grids(points, rng).items():
            for name, model in REGISTRY.items():
                draws = make_draws(name, size, rng)
                arguments = (residuals, coordinate, weights, draws)
                seconds = best_time(lambda m=model, a=arguments: m().log_prob(*a), options.repeats)
                known = SPECIFIED[points] if name == "ornstein_uhlenbeck" else ""
                print(f"{name},{grid},{points},{size},{1e6 * seconds / size:.2f},{known}")
            peer = celerite2_time(coordinate, residuals[0], options.repeats)
            if peer is not None:
                print(f"celerite2 (OU + white),{grid},{points},1,{1e6 * peer:.2f},")


if __name__ == "__main__":
    main()
