"""Steps along the coordinate, and what follows from one to the next."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from scipy import stats
from tests.shared.noise_oracle import GAUSSIAN, RELATIVE, covariance
from tests.shared.noise_records import make_draws, one

from deabayes.noise import REGISTRY
from deabayes.noise.kalman import distances, matern32_transition


@pytest.mark.parametrize("name", ["ornstein_uhlenbeck", "matern32"])
@pytest.mark.parametrize("length", [1e-9, 1e-3, 1e3, 1e7])
def test_short_and_long_correlation(name, length):
    """Short: one more white part; long: an offset common to all points."""
    suffix = {"ornstein_uhlenbeck": "ou", "matern32": "matern"}[name]
    rng = np.random.default_rng(9)
    coordinate = np.cumsum(rng.uniform(0.5, 2.0, 50))
    weights = 1.0 / rng.integers(1, 10, 50)
    draws = {"sigma_white": np.array([0.3]), f"sigma_{suffix}": np.array([0.7])}
    draws[f"tau_{suffix}"] = np.array([length])
    residuals = 0.7 * rng.normal() + 0.3 * np.sqrt(weights) * rng.normal(size=(1, 50))
    limit = np.eye(50) if length < 1.0 else np.ones((50, 50))
    exact = covariance(name, coordinate, weights, one(draws, 0))
    if length in (1e-9, 1e7):
        np.testing.assert_allclose(exact, 0.49 * limit + 0.09 * np.diag(weights), rtol=2e-5)
    expected = stats.multivariate_normal.logpdf(residuals[0], cov=exact)
    found = REGISTRY[name]().log_prob(residuals, coordinate, weights, draws)
    assert found[0] == pytest.approx(expected, rel=RELATIVE)


def test_distances_add_up_along_a_coordinate_that_turns_back():
    rng = np.random.default_rng(12)
    there = np.linspace(1.0, 3.0, 30)
    path = np.concatenate([there, there[::-1][1:]])
    weights = np.ones(path.size)
    draws = make_draws("ornstein_uhlenbeck", 4, rng)
    residuals = rng.normal(size=(4, path.size))
    walked = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path)))])
    model = REGISTRY["ornstein_uhlenbeck"]()
    np.testing.assert_allclose(
        model.log_prob(residuals, path, weights, draws),
        model.log_prob(residuals, walked, weights, draws),
        rtol=1e-10,
    )


@pytest.mark.parametrize("x", [1e-8, 1e-4, 0.1, 0.249, 0.251, 2.0, 30.0, 400.0])
def test_matern_driving_covariance_keeps_its_digits(x):
    """Q = I - Phi Phi^T in 60 digits."""
    with localcontext() as context:
        context.prec = 60
        d = Decimal(x)
        squared = (-2 * d).exp()
        q11 = 1 - squared * ((1 + d) ** 2 + d**2)
        q22 = 1 - squared * ((1 - d) ** 2 + d**2)
        q12 = 2 * d**2 * squared
    np.testing.assert_allclose(
        matern32_transition(x)[4:], [float(q11), float(q12), float(q22)], rtol=1e-12, atol=1e-300
    )


def test_equal_steps_are_recognised_and_others_are_not():
    steps = distances(np.linspace(1.0, 1001.0, 100001))
    assert np.unique(steps[1:]).size == 1
    chirp = np.cumsum(0.1 * (1.0 + 1e-9 * np.arange(1000)))
    np.testing.assert_allclose(
        distances(chirp)[1:], np.diff(chirp), atol=4.0 * np.finfo(float).eps * chirp[-1]
    )


@pytest.mark.parametrize("name", GAUSSIAN)
def test_steps_of_a_microsecond_count_at_clock_times(name):
    """2^-20 s, which a clock time of 1.7e9 s holds exactly."""
    rng = np.random.default_rng(14)
    elapsed = 2.0**-20 * np.arange(50.0)
    draws = make_draws(name, 4, rng) | {
        key: np.full(4, 1e-5) for key in ("tau_ou", "tau_ar1", "tau_matern")
    }
    residuals, weights = rng.normal(size=(4, 50)), np.ones(50)
    model = REGISTRY[name]()
    np.testing.assert_array_equal(
        model.log_prob(residuals, 1.7e9 + elapsed, weights, draws),
        model.log_prob(residuals, elapsed, weights, draws),
    )
