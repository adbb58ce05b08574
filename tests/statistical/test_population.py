"""Mean and spread of a population, sampled, against sums over a dense grid."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.populations import MEDIANS, SIGMAS, World, world

from deabayes.experiment import FloatArray
from deabayes.population.model import RELATIVE_SPREAD, sample
from deabayes.study import Sampling

SETTINGS = Sampling(ensembles=2, walkers=32, particles=256, max_steps=8000, seed=1)


def on_grid(known: World, k: int) -> dict[str, tuple[float, float]]:
    """Mean and sd of m_k and s_k: parameters are independent of each other here."""
    m = np.linspace(-2.0, 2.0, 801) + known.y[:, k].mean()
    s = np.linspace(1e-4, 2.5, 1000)
    log_p = -0.5 * ((m - np.log(MEDIANS[k])) / SIGMAS[k])[:, None] ** 2
    log_p = log_p - 0.5 * (s / RELATIVE_SPREAD)[None] ** 2
    for y, sd in zip(known.y[:, k], known.sd[:, k], strict=True):
        variance = (sd**2 + s**2)[None]
        log_p = log_p - 0.5 * (y - m[:, None]) ** 2 / variance - 0.5 * np.log(variance)
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    return {"mean": moments(m, p.sum(axis=1)), "spread": moments(s, p.sum(axis=0))}


def moments(x: FloatArray, p: FloatArray) -> tuple[float, float]:
    mean = float(p @ x)
    return mean, float(np.sqrt(p @ (x - mean) ** 2))


@pytest.mark.parametrize("spread", [(0.02, 0.3), (0.15, 0.05)])
def test_mean_and_spread_are_those_of_the_grid(spread: tuple[float, float]) -> None:
    """A spread much below the readings' errors, and one far above."""
    rng = np.random.default_rng(11)
    known = world(np.log([2e4, 3.0]), np.array(spread), np.full((6, 2), 0.08), rng)
    pooled = sample(known.model, SETTINGS, np.random.SeedSequence(1))
    assert pooled.convergence.converged, pooled.convergence.reasons
    z = pooled.chain.reshape(-1, known.model.dimension)
    centres, spreads = known.model.split(known.model.prior.to_parameters(z))
    for k in range(2):
        exact = on_grid(known, k)
        for found, (mean, sd) in ((centres[:, k], exact["mean"]), (spreads[:, k], exact["spread"])):
            assert abs(found.mean() - mean) < 0.1 * sd
            assert found.std() == pytest.approx(sd, rel=0.1)
