"""Maximum of a likelihood, and the bridge's parts, by hand."""

import numpy as np
import pytest

from deabayes.comparison.scoring import bridge_evidence, bridge_log_ratio, maximum_log_likelihood
from deabayes.sampling.problem import Split


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
    none = np.empty((1, 0))
    return lambda z: Split(
        np.repeat(none, len(z), 0), np.repeat(none, len(z), 0), log_likelihood(z)
    )


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


def test_the_priors_bounds_stay():
    """A peak nine prior deviations out is not reached."""
    split = of_no_point(lambda z: -((z[:, 0] - 9.0) ** 2))
    assert maximum_log_likelihood(split, np.zeros((1, 1))) == pytest.approx(-9.0, abs=0.01)


@pytest.mark.parametrize(("start", "highest"), [(19.0, 0.0), (15.0, -(2.0**2))])
def test_a_posterior_far_out_in_the_prior_has_its_own_maximum(start, highest):
    """At z = 20; the bounds are three beyond where the draws are."""
    split = of_no_point(lambda z: -((z[:, 0] - 20.0) ** 2))
    found = maximum_log_likelihood(split, np.array([[start]]))
    assert found == pytest.approx(highest, abs=0.02)
