"""Evidence by bridge and nested sampling against closed forms, and the highest likelihood."""

import sys

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from deabayes.comparison.evidence import bridge_evidence, bridge_log_ratio, maximum_log_likelihood
from deabayes.comparison.nested import nested
from deabayes.faults import UserError
from deabayes.sampling.problem import Split


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


def test_bridge_recovers_the_evidence_of_a_gaussian():
    log_posterior, mean, covariance, evidence = gaussian_problem(8, 5)
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


def test_nested_sampling_recovers_the_evidence_of_a_normal_model():
    """y = A z + e, z ~ N(0, I), e ~ N(0, I): log N(y; 0, A A^T + I)."""
    rng = np.random.default_rng(3)
    design = rng.normal(size=(6, 2))
    y = design @ np.array([0.5, -1.0]) + rng.normal(size=6)
    exact = multivariate_normal(np.zeros(6), design @ design.T + np.eye(6)).logpdf(y)

    def log_likelihood(z):
        return -0.5 * np.sum((y - z @ design.T) ** 2, axis=1) - 3.0 * np.log(2.0 * np.pi)

    results, _ = nested(log_likelihood, 2, np.random.SeedSequence(4), live=200)
    error = float(results.logzerr[-1])
    assert 0.0 < error < 0.3
    assert float(results.logz[-1]) == pytest.approx(exact, abs=3 * error)


def test_without_dynesty_the_message_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "dynesty", None)
    with pytest.raises(UserError, match=r"needs the package dynesty; `pip install"):
        nested(lambda z: -np.sum(z**2, axis=1), 2, np.random.SeedSequence(1))


def test_correlated_draws_count_as_many_as_they_are_worth():
    """One draw of each, e^l of 3 and 2: the optimal bridge is a root of a quadratic.

    s2 r^2 + (s1 - s2) 2 r - 6 s1 = 0 with s1 = 0.2 for a quarter of a draw.
    """
    share = 0.2
    rest = 1.0 - share
    middle = 2.0 * (share - rest)
    root = (-middle + np.sqrt(middle**2 + 24.0 * share * rest)) / (2.0 * rest)
    found = bridge_log_ratio(np.log([3.0]), np.log([2.0]), 0.25)
    assert found == pytest.approx(np.log(root), abs=1e-8)


def test_the_error_is_that_of_a_mean_of_independent_estimates():
    """Draws that are too wide scatter the estimates of four ensembles, whose mean counts."""

    def log_density(z):
        return -np.sum(np.abs(z), axis=1)

    draws = np.random.default_rng(1).laplace(size=(4, 200, 2))
    found = bridge_evidence(log_density, draws, 200.0, np.random.SeedSequence(2), 1)
    assert len(set(found.estimates)) == 4
    assert found.mcse == pytest.approx(np.std(found.estimates, ddof=1) / 2.0)
    assert found.log_evidence == pytest.approx(np.log(np.mean(np.exp(found.estimates))))


def of_no_point(log_likelihood):
    return lambda z: Split(np.empty((len(z), 0)), np.empty((len(z), 0)), log_likelihood(z))


def test_the_highest_of_all_climbs_counts_and_the_prior_does_not():
    """Two peaks, the higher one at (2, -1)."""

    def hills(z):
        high = 7.0 - np.sum((z - [2.0, -1.0]) ** 2, axis=1)
        return np.where(z[:, 0] > 0.0, high, 3.0 - np.sum((z + 2.0) ** 2, axis=1))

    starts = np.array([[0.5, 0.5], [-1.0, -1.0]])
    for order in (starts, starts[::-1]):
        assert maximum_log_likelihood(of_no_point(hills), order) == pytest.approx(7.0, abs=0.01)


def test_the_maximum_of_a_thin_and_curved_likelihood_is_found():
    """With one step of difference for all directions a climb would end where it begins."""

    def split(z):
        scores = np.stack([z[:, 0] - 1.0, (z[:, 1] - z[:, 0] ** 2) / 1e-2], axis=1)
        return Split(scores, np.zeros_like(scores), np.full(len(z), 5.0))

    start = np.array([[-0.5, 0.25]])
    assert maximum_log_likelihood(split, start) == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize(
    ("peak", "start", "highest"),
    [(9.0, 0.0, -9.0), (20.0, 19.0, 0.0), (20.0, 15.0, -(2.0**2))],
)
def test_a_climb_stays_within_six_prior_sds_or_three_beyond_its_start(peak, start, highest):
    split = of_no_point(lambda z: -((z[:, 0] - peak) ** 2))
    found = maximum_log_likelihood(split, np.array([[start]]))
    assert found == pytest.approx(highest, abs=0.02)
