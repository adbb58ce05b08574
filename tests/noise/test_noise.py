"""Noise models against dense covariances, celerite2 and one another."""

import numpy as np
import pytest
from scipy import stats
from tests.shared.noise_oracle import GAUSSIAN, RELATIVE, covariance
from tests.shared.noise_records import make_draws, one, record

from deabayes.noise import REGISTRY


@pytest.mark.parametrize("grid", ["irregular", "regular"])
@pytest.mark.parametrize("name", GAUSSIAN)
def test_dense_covariance(name, grid):
    rng = np.random.default_rng(1)
    coordinate, weights = record(rng, grid=grid)
    draws = make_draws(name, 40, rng)
    residuals = rng.normal(0.0, 0.5, (40, coordinate.size))
    model = REGISTRY[name]()
    expected = [
        stats.multivariate_normal.logpdf(
            residuals[k], cov=covariance(name, coordinate, weights, one(draws, k))
        )
        for k in range(40)
    ]
    log_prob = model.log_prob(residuals, coordinate, weights, draws)
    pointwise = model.pointwise_log_prob(residuals, coordinate, weights, draws)
    np.testing.assert_allclose(log_prob, expected, rtol=RELATIVE)
    np.testing.assert_allclose(pointwise.sum(axis=1), expected, rtol=RELATIVE)


def test_celerite2():
    celerite2 = pytest.importorskip("celerite2")
    rng = np.random.default_rng(2)
    coordinate, weights = record(rng, 2000)
    draws = make_draws("ornstein_uhlenbeck", 5, rng)
    residuals = rng.normal(0.0, 0.5, (5, 2000))
    found = REGISTRY["ornstein_uhlenbeck"]().log_prob(residuals, coordinate, weights, draws)
    for k in range(5):
        draw = one(draws, k)
        term = celerite2.terms.RealTerm(a=draw["sigma_ou"] ** 2, c=1.0 / draw["tau_ou"])
        process = celerite2.GaussianProcess(term)
        process.compute(coordinate, diag=draw["sigma_white"] ** 2 * weights)
        assert found[k] == pytest.approx(process.log_likelihood(residuals[k]), rel=RELATIVE)


def test_student_t_against_scipy():
    rng = np.random.default_rng(3)
    coordinate, weights = record(rng)
    draws = make_draws("student_t", 8, rng)
    residuals = rng.standard_t(3.0, (8, coordinate.size))
    expected = stats.t.logpdf(
        residuals,
        draws["degrees_of_freedom"][:, None],
        scale=draws["sigma_white"][:, None] * np.sqrt(weights),
    )
    model = REGISTRY["student_t"]()
    np.testing.assert_allclose(
        model.pointwise_log_prob(residuals, coordinate, weights, draws), expected, rtol=RELATIVE
    )
    probability = stats.t.cdf(
        residuals,
        draws["degrees_of_freedom"][:, None],
        scale=draws["sigma_white"][:, None] * np.sqrt(weights),
    )
    near = np.abs(probability - 0.5) < 0.499
    scores = model.innovations(residuals, coordinate, weights, draws)
    np.testing.assert_allclose(scores[near], stats.norm.ppf(probability[near]), atol=1e-9)


@pytest.mark.parametrize("scale", [1e-15, 1e12])
@pytest.mark.parametrize("name", GAUSSIAN)
def test_densities_do_not_depend_on_the_unit(name, scale):
    """Residuals and sigmas in other units: the density changes by N log(scale) only."""
    rng = np.random.default_rng(10)
    coordinate, weights = record(rng, 100)
    draws = make_draws(name, 3, rng)
    residuals = rng.normal(size=(3, 100))
    other = {n: v * scale if n.startswith("sigma") else v for n, v in draws.items()}
    model = REGISTRY[name]()
    np.testing.assert_allclose(
        model.log_prob(residuals * scale, coordinate, weights, other) + 100 * np.log(scale),
        model.log_prob(residuals, coordinate, weights, draws),
        rtol=1e-11,
    )


def test_extreme_ratio_of_the_two_parts():
    """No underflow where white noise is 1e-14 of the correlated variance, heavily averaged."""
    rng = np.random.default_rng(11)
    coordinate, weights = np.arange(64.0), np.full(64, 1e-4)
    draws = {
        "sigma_white": np.array([1e-7, 1.0]),
        "sigma_ou": np.array([1.0, 1e-9]),
        "tau_ou": np.array([1e20, 1e9]),
    }
    residuals = 1e-5 * rng.normal(size=(2, 64))
    model = REGISTRY["ornstein_uhlenbeck"]()
    np.testing.assert_allclose(
        model.log_prob(residuals, coordinate, weights, draws),
        model.pointwise_log_prob(residuals, coordinate, weights, draws).sum(axis=1),
        rtol=1e-9,
    )


def test_without_a_zero_offset_the_density_is_the_usual_one():
    """Also its limit: where it is as good as free, the level of a record tells nothing."""
    rng = np.random.default_rng(14)
    coordinate, weights = record(rng, 80)
    draws = make_draws("ornstein_uhlenbeck", 5, rng)
    residuals = rng.normal(size=(5, 80))
    usual = REGISTRY["ornstein_uhlenbeck"]().log_prob(residuals, coordinate, weights, draws)
    model = REGISTRY["ornstein_uhlenbeck_offset"]()

    def found(sigma, shift=0.0):
        offset = {"sigma_offset": np.full(5, sigma)}
        return model.log_prob(residuals + shift, coordinate, weights, draws | offset)

    np.testing.assert_allclose(found(0.0), usual, rtol=1e-12)
    np.testing.assert_allclose(found(1e6), found(1e6, shift=3.0), rtol=1e-6)


@pytest.mark.parametrize("far", [1.0, 1e3, 1e6])
def test_a_large_zero_offset_costs_no_digits(far):
    """In units of the noise: the level, of which nothing is known, must not swamp what is."""
    rng = np.random.default_rng(15)
    coordinate, weights = record(rng, 80)
    draws = {
        "sigma_white": np.full(4, 0.5),
        "sigma_ou": np.full(4, 1.0),
        "tau_ou": np.full(4, 2.0),
        "sigma_offset": np.full(4, far),
    }
    residuals = rng.normal(size=(4, 80)) + far
    model = REGISTRY["ornstein_uhlenbeck_offset"]()
    np.testing.assert_allclose(
        model.log_prob(residuals, coordinate, weights, draws),
        model.pointwise_log_prob(residuals, coordinate, weights, draws).sum(axis=1),
        rtol=1e-8,
    )


def test_student_t_has_no_variance_where_its_tails_are_heavy():
    draws = {"sigma_white": np.ones(2), "degrees_of_freedom": np.array([1.5, 4.0])}
    _, white = REGISTRY["student_t"]().variances(draws, np.full(3, 0.5))
    assert white[0] == np.inf
    assert white[1] == pytest.approx(1.0)
