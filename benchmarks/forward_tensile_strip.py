"""Forward model of the tensile strip against scipy at equal accuracy, in one run.

Five VHB-like relaxations (ramp at 0.25 1/s to stretch 1.5-3.5, hold 1800 s, 180 outputs
each), kv_gm_3. The project's time is that of 128 prior draws in a batch; scipy's that of
a few of them one by one, each segment on its own, at the loosest tolerance whose worst
error is within 1e-6 of the range (or the tightest tried). Prints milliseconds per draw
for all five records, and ratios.

    python benchmarks/forward_tensile_strip.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from deabayes.experiment import Excitation, FloatArray, Specimen
from deabayes.systems.tensile_strip.system import TensileStrip

TOPS = (1.5, 2.0, 2.5, 3.0, 3.5)
WALKERS, PEER_DRAWS = 128, 3
TARGET = 1e-6
PEER_TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
Draws = dict[str, FloatArray]


def records() -> list[tuple[Excitation, FloatArray]]:
    """Excitation and output times of the five relaxations."""
    found = []
    for top in TOPS:
        ramp = (top - 1.0) / 0.25
        knots, stretch = np.array([0.0, ramp, ramp + 1800.0]), np.array([1.0, top, top])
        outputs = np.unique(np.r_[np.linspace(0.1, ramp, 40), ramp + np.geomspace(0.1, 1800, 140)])
        found.append((Excitation("stretch", "1", knots, stretch), outputs))
    return found


def prior_draws(system: TensileStrip, count: int) -> Draws:
    """Independent prior draws, relaxation times put in order."""
    rng = np.random.default_rng(1)
    draws = {p.name: p.prior.from_normal(rng.standard_normal(count)) for p in system.parameters()}
    names = [f"tau_beta_{i}" for i in range(1, system.order + 1)]
    ordered = np.sort([draws[name] for name in names], axis=0)
    return draws | dict(zip(names, ordered, strict=True))


def peer(method: str, tolerance: float, draws: Draws, walker: int) -> list[FloatArray]:
    """Nominal stress of the five records by scipy, one draw."""
    from scipy.integrate import solve_ivp

    single = {name: float(values[walker]) for name, values in draws.items()}
    mu = np.array([single[f"mu_beta_{i}"] for i in (1, 2, 3)])
    tau = np.array([single[f"tau_beta_{i}"] for i in (1, 2, 3)])
    limit = single["J_beta"]
    found = []
    for excitation, outputs in records():
        knots, values, xi = excitation.coordinate, excitation.values, np.ones(3)
        stress = np.empty_like(outputs)
        for k in range(2):
            rate = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])

            def flow(t: float, y: FloatArray, k: int = k, rate: float = rate) -> FloatArray:
                lam = values[k] + rate * (t - knots[k])  # noqa: B023
                argument = 1.0 - (lam * lam / (y * y) + 2.0 * y / lam - 3.0) / limit
                return (lam * lam / (y * y * y) - 1.0 / lam) / argument / tau

            inside = (outputs >= knots[k]) & ((outputs < knots[k + 1]) | (k == 1))
            asked = np.unique(np.append(outputs[inside], knots[k + 1]))
            y = solve_ivp(
                flow, knots[k : k + 2], xi, method, asked, rtol=tolerance, atol=1e-2 * tolerance
            ).y
            lam, at = values[k] + rate * (outputs[inside] - knots[k]), y[:, : inside.sum()]
            argument = 1.0 - (lam**2 / at**2 + 2.0 * at / lam - 3.0) / limit
            stress[inside] = mu @ ((lam / at**2 - at / lam**2) / argument)
            invariant = lam**2 + 2.0 / lam - 3.0
            spring = single["mu_alpha"] * (lam - lam**-2) / (1.0 - invariant / single["J_alpha"])
            stress[inside] += spring + single["zeta_alpha"] * rate
            xi = y[:, -1]
        found.append(stress)
    return found


def worst_error(found: list[FloatArray], expected: list[FloatArray]) -> float:
    """Largest error over the records, of each record's range."""
    return max(
        float(np.max(np.abs(a - b)) / np.ptp(b)) for a, b in zip(found, expected, strict=True)
    )


def seconds(run: Callable[[], object], repeats: int) -> float:
    """Shortest of several timings."""
    timings = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        timings.append(time.perf_counter() - start)
    return min(timings)


def time_peer(method: str, draws: Draws, expected: list[FloatArray]) -> tuple[float, float, float]:
    """Seconds per draw, worst error and tolerance of a scipy method at equal accuracy."""
    for tolerance in PEER_TOLERANCES:
        start = time.perf_counter()
        found = [peer(method, tolerance, draws, walker) for walker in range(PEER_DRAWS)]
        elapsed = (time.perf_counter() - start) / PEER_DRAWS
        error = max(
            worst_error(found[walker], [record[walker] for record in expected])
            for walker in range(PEER_DRAWS)
        )
        if error <= TARGET:
            break
    return elapsed, error, tolerance


def main() -> None:
    """Print the table."""
    start = time.perf_counter()
    specimen = Specimen("benchmark", "tensile_strip", {}, {})
    system = TensileStrip("kv_gm_3", specimen)
    draws = prior_draws(system, WALKERS)
    system.predict(*records()[0], "nominal_stress", draws)
    print(f"kernel ready in {time.perf_counter() - start:.1f} s (cold or from the cache)")
    simulators = [system.simulator(*record, "nominal_stress") for record in records()]
    tight = TensileStrip("kv_gm_3", specimen, 1e-11)
    expected = [tight.predict(*record, "nominal_stress", draws) for record in records()]
    found = [simulate(draws) for simulate in simulators]
    errors = [
        worst_error([record[w] for record in found], [record[w] for record in expected])
        for w in range(WALKERS)
    ]
    batch = seconds(lambda: [simulate(draws) for simulate in simulators], 30)
    own = batch / WALKERS
    print(f"{WALKERS} draws x {len(TOPS)} records: {1e3 * batch:.2f} ms in a batch")
    print(f"{'method':<24}{'ms per draw':>12}{'worst error':>13}{'ratio':>8}")
    print(f"{'deabayes, lanes':<24}{1e3 * own:>12.4f}{max(errors):>13.1e}{1:>8}")
    for method in ("RK45", "LSODA", "Radau"):
        elapsed, error, tolerance = time_peer(method, draws, expected)
        name = f"scipy {method} {tolerance:.0e}"
        print(f"{name:<24}{1e3 * elapsed:>12.4f}{error:>13.1e}{elapsed / own:>8.0f}")


if __name__ == "__main__":
    main()
