"""Samples follow the law whose density the noise model computes."""

import numpy as np
import pytest
from scipy import stats
from tests.shared.noise_oracle import GAUSSIAN, covariance

from deabayes.noise import REGISTRY

DRAWS = 20000
COORDINATE = np.array([0.0, 0.3, 0.5, 1.5, 1.6, 4.0, 4.0, 9.0])
WEIGHTS = np.array([1.0, 0.1, 1.0, 0.5, 1.0, 1.0, 0.2, 1.0])
TRUTH = {
    "sigma_white": 0.4,
    "sigma_ou": 1.0,
    "tau_ou": 2.0,
    "sigma_ar1": 1.0,
    "tau_ar1": 2.0,
    "sigma_offset": 0.7,
    "sigma_matern": 1.0,
    "tau_matern": 2.0,
    "degrees_of_freedom": 4.0,
}


def truth(name, size=DRAWS):
    parameters = REGISTRY[name]().parameters("1", 1.0, 10.0)
    values = {p.name: TRUTH.get(p.name, float(p.prior.from_normal(0.0))) for p in parameters}
    return {name: np.full(size, value) for name, value in values.items()}


def covariance_chi_square(samples, expected):
    """Sum of squared standard scores of the whitened sample covariance's entries."""
    factor = np.linalg.cholesky(expected)
    white = np.linalg.solve(factor, samples.T)
    size = samples.shape[1]
    deviation = white @ white.T / samples.shape[0] - np.eye(size)
    score = deviation * np.sqrt(samples.shape[0] / (1.0 + np.eye(size)))
    entries = score[np.triu_indices(size)]
    return stats.chi2.sf(np.sum(entries**2), entries.size)


@pytest.mark.parametrize("name", GAUSSIAN)
def test_covariance_of_samples(name):
    keep = np.arange(8) if name != "ar1" else np.array([0, 1, 2, 3, 4, 5, 7])
    coordinate, weights = COORDINATE[keep], WEIGHTS[keep]
    discrepancy, white = REGISTRY[name]().sample(
        np.random.default_rng(1), coordinate, weights, truth(name)
    )
    draw = {n: v[0] for n, v in truth(name, 1).items()}
    samples = discrepancy + white
    assert covariance_chi_square(samples, covariance(name, coordinate, weights, draw)) > 1e-3
    wrong = {n: 1.05 * v if n == list(draw)[-1] else v for n, v in draw.items()}
    assert covariance_chi_square(samples, covariance(name, coordinate, weights, wrong)) < 1e-3


@pytest.mark.parametrize("name", ["ornstein_uhlenbeck", "ornstein_uhlenbeck_offset", "matern32"])
def test_correlated_and_white_parts_have_their_covariances(name):
    discrepancy, white = REGISTRY[name]().sample(
        np.random.default_rng(2), COORDINATE, WEIGHTS, truth(name)
    )
    draw = {n: v[0] for n, v in truth(name, 1).items()}
    correlated = covariance(name, COORDINATE, WEIGHTS, {**draw, "sigma_white": 0.0})
    np.testing.assert_allclose(discrepancy[:, 5], discrepancy[:, 6], atol=1e-12)
    keep = np.array([0, 1, 2, 3, 4, 5, 7])
    assert covariance_chi_square(discrepancy[:, keep], correlated[np.ix_(keep, keep)]) > 1e-3
    assert covariance_chi_square(white, 0.16 * np.diag(WEIGHTS)) > 1e-3


@pytest.mark.parametrize("name", REGISTRY)
def test_innovations_of_samples_are_standard_normal(name):
    """Probability integral transform: uniform marginals, and no correlation left."""
    rng = np.random.default_rng(3)
    coordinate = np.cumsum(rng.exponential(0.5, 40))
    weights = 1.0 / rng.integers(1, 5, 40)
    model, draws = REGISTRY[name](), truth(name, 2000)
    residuals = sum(model.sample(rng, coordinate, weights, draws))
    scores = model.innovations(residuals, coordinate, weights, draws)
    assert stats.kstest(scores.ravel(), "norm").pvalue > 1e-3
    correlation = np.mean(scores[:, 1:] * scores[:, :-1], axis=0) * np.sqrt(2000.0)
    assert stats.kstest(correlation, "norm").pvalue > 1e-3


@pytest.mark.parametrize(
    "name", ["ornstein_uhlenbeck", "ornstein_uhlenbeck_offset", "ar1", "matern32"]
)
def test_the_check_sees_a_wrong_correlation_time(name):
    rng = np.random.default_rng(4)
    coordinate = np.cumsum(rng.exponential(0.5, 40))
    weights = np.ones(40)
    model, draws = REGISTRY[name](), truth(name, 2000)
    residuals = sum(model.sample(rng, coordinate, weights, draws))
    wrong = {n: 1.5 * v if n.startswith("tau") else v for n, v in draws.items()}
    scores = model.innovations(residuals, coordinate, weights, wrong)
    assert stats.kstest(scores.ravel(), "norm").pvalue < 1e-3


@pytest.mark.parametrize(
    "name", ["ornstein_uhlenbeck", "ornstein_uhlenbeck_offset", "white", "student_t"]
)
def test_the_truth_has_the_largest_expected_log_prob(name):
    """Gibbs' inequality, for each parameter."""
    rng = np.random.default_rng(5)
    coordinate = np.cumsum(rng.exponential(0.5, 60))
    weights = 1.0 / rng.integers(1, 5, 60)
    model, draws = REGISTRY[name](), truth(name, 3000)
    residuals = sum(model.sample(rng, coordinate, weights, draws))
    best = model.log_prob(residuals, coordinate, weights, draws)
    for parameter in draws:
        for factor in (0.7, 1.4):
            other = {**draws, parameter: factor * draws[parameter]}
            loss = best - model.log_prob(residuals, coordinate, weights, other)
            assert loss.mean() > 3.0 * loss.std() / np.sqrt(loss.size), (parameter, factor)
