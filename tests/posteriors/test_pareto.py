"""Smoothed importance weights: which way they weigh, and what is said of their tail."""

import numpy as np
import pytest
from scipy.special import logsumexp

from deabayes.posteriors.sensitivity import smoothed


def test_only_the_largest_weights_are_smoothed():
    log_weights = 0.3 * np.random.default_rng(1).normal(size=2000)
    found, k_hat = smoothed(log_weights)
    below = log_weights < np.quantile(log_weights, 0.8)
    change = found[below] - log_weights[below]
    np.testing.assert_allclose(change, change[0], atol=1e-12)
    assert logsumexp(found) == pytest.approx(0.0, abs=1e-12)
    assert k_hat < 0.5


@pytest.mark.parametrize("shape", [0.4, 0.9])
def test_the_shape_is_that_of_the_largest_weights(shape):
    """Weights u^(-k) of uniform u have a Pareto tail of the shape k; their inverses have none."""
    log_weights = -shape * np.log(np.random.default_rng(2).uniform(size=20000))
    found, k_hat = smoothed(log_weights)
    assert k_hat == pytest.approx(shape, abs=0.12)
    assert smoothed(-log_weights)[1] < 0.1
    assert np.exp(found).sum() == pytest.approx(1.0)


def test_even_weights_have_no_tail():
    found, k_hat = smoothed(np.full(50, -3.0) + 1e-9 * np.arange(50))
    np.testing.assert_allclose(np.exp(found), 0.02, rtol=1e-6)
    assert k_hat == 0.0


@pytest.mark.parametrize("log_weights", [np.array([0.0, 2.0, 5.0]), np.repeat([0.0, 1.0], 500)])
def test_where_no_tail_can_be_fitted_the_shape_is_infinite(log_weights):
    found, k_hat = smoothed(log_weights)
    assert k_hat == np.inf
    np.testing.assert_allclose(found, log_weights - logsumexp(log_weights))
