"""Expected information of experiments, against linear models whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from deabayes.information import (
    Predictive,
    Reading,
    candidate_information,
)
from deabayes.noise import REGISTRY as NOISE

TIME = np.linspace(0.0, 1.0, 12)
CONSTANT, LINE = np.ones((1, 12)), np.stack([np.ones(12), TIME])
SIGMA = 0.3


def reading(curves, noise="white", scale=1.0, **noise_draws):
    draws = {"sigma_white": SIGMA / scale} | noise_draws
    size = len(curves)
    return Reading(
        curves, np.full(size, scale), NOISE[noise](), {n: np.full(size, v) for n, v in draws.items()},
        TIME, np.ones(TIME.size),
    )  # fmt: skip


def predictive(curves, known=400, **settings):
    whole = reading(curves, **settings)
    return Predictive((whole.of_draws(slice(0, known)),), (whole.of_draws(slice(known, None)),))


def linear(design, mean, sd, seed, size=1400):
    """Curves mean + design^T theta, theta ~ N(0, sd^2)."""
    theta = sd * np.random.default_rng(seed).standard_normal((size, len(design)))
    return mean + theta @ design


def law(design, mean, sd):
    covariance = sd**2 * design.T @ design + SIGMA**2 * np.eye(TIME.size)
    return multivariate_normal(np.broadcast_to(mean, TIME.size), covariance)


def brute_force(laws, size=200_000):
    """I(M; y) and the probability of naming M rightly, with the densities known."""
    rng = np.random.default_rng(99)
    nats, right = [], []
    for truth, each in enumerate(laws):
        log_p = np.stack([other.logpdf(each.rvs(size, rng)) for other in [each]])
        y = each.rvs(size, rng)
        log_p = np.stack([other.logpdf(y) for other in laws])
        nats.append(np.mean(log_p[truth] - np.logaddexp.reduce(log_p, axis=0)))
        right.append(np.mean(log_p.argmax(axis=0) == truth))
    return np.log(len(laws)) + np.mean(nats), np.mean(right)


@pytest.mark.parametrize(
    ("mean", "sd"), [(0.0, 0.5), (0.4, 0.5), (0.4, 0.1), (2.0, 5.0)]
)  # from hardly anything to nearly all that there is to know
def test_candidates_are_told_apart_as_by_brute_force(mean, sd):
    models = [(CONSTANT, 0.0, sd), (LINE, mean, sd)]
    exact, right = brute_force([law(*model) for model in models])
    made = [predictive(linear(*model, seed)) for seed, model in enumerate(models)]
    found = candidate_information(made, np.random.default_rng(5))
    assert found.nats == pytest.approx(exact, abs=4 * found.nats_error + 0.01)
    assert found.probability_right == pytest.approx(right, abs=4 * found.probability_right_error)
    assert found.nats_error < 0.02
