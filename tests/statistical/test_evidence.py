"""Bridge evidence against closed forms, and its stated error."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from deabayes.comparison.scoring import bridge_evidence, bridge_log_ratio


def gaussian_problem(dimension, seed):
    """N(0, I) prior times a Gaussian likelihood: posterior and evidence in closed form."""
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(30, dimension))
    data = design @ rng.normal(size=dimension) + rng.normal(size=30)
    precision = np.eye(dimension) + design.T @ design
    covariance = np.linalg.inv(precision)
    mean = covariance @ design.T @ data
    evidence = multivariate_normal(np.zeros(30), np.eye(30) + design @ design.T).logpdf(data)

    def log_posterior(z):
        residual = data - z @ design.T
        return (
            -0.5 * np.sum(residual**2, 1)
            - 0.5 * np.sum(z**2, 1)
            - (0.5 * (30 + dimension) * np.log(2 * np.pi))
        )

    return log_posterior, mean, covariance, float(evidence)


@pytest.mark.parametrize("dimension", [2, 8])
def test_bridge_recovers_the_evidence_of_a_gaussian(dimension):
    log_posterior, mean, covariance, evidence = gaussian_problem(dimension, 5)
    rng = np.random.default_rng(6)
    draws = rng.multivariate_normal(mean, covariance, size=(4, 1500))
    found = bridge_evidence(log_posterior, draws, 1500.0, np.random.SeedSequence(7))
    assert found.log_evidence == pytest.approx(evidence, abs=0.05)
    assert found.mcse < 0.05


def test_bridge_covers_two_modes():
    def log_density(z):
        parts = [multivariate_normal([m] * 3, 0.3).logpdf(z) for m in (-2.0, 2.0)]
        return logsumexp(parts, axis=0, b=np.array([[0.2], [0.8]])) + 3.0

    rng = np.random.default_rng(8)
    signs = np.where(rng.random((4, 2000, 1)) < 0.2, -2.0, 2.0)
    draws = signs + np.sqrt(0.3) * rng.normal(size=(4, 2000, 3))
    found = bridge_evidence(log_density, draws, 2000.0, np.random.SeedSequence(9))
    assert found.log_evidence == pytest.approx(3.0, abs=0.06)


def test_bridge_is_exact_when_the_proposal_is_the_target():
    assert bridge_log_ratio(np.full(100, 1.7), np.full(80, 1.7), 100.0) == pytest.approx(1.7)
