"""Ordered groups of a prior: the law of sorted draws that keep their distance."""

import numpy as np
import pytest
from scipy import stats
from tests.shared.priors import ALPHA, RELAXATION, TAU

from deabayes.faults import UserError
from deabayes.prior.distributions import LogNormal, LogUniform, Uniform
from deabayes.prior.joint import Prior


def test_ordered_group_is_smooth_without_reaching_its_bounds():
    prior = Prior(TAU)
    z = np.zeros((161, 3))
    z[:, 2] = np.linspace(-8.0, 8.0, 161)
    log_tau = np.log(prior.to_parameters(z)[:, 2])
    steps = np.diff(log_tau)
    assert np.all(steps[z[:-1, 2] < 5.0] > 0.0)
    z[:, 2] = 0.0
    z[:, 0] = np.linspace(-8.0, 8.0, 161)
    theta = prior.to_parameters(z)
    assert np.all(theta[:, 1] / theta[:, 0] >= 2.0)
    assert np.all(theta[:, 0] > 0.01)


@pytest.mark.parametrize("ratio", [1.0, 2.0, 10.0])
def test_ordered_samples_match_rejection(ratio):
    """Sorted iid draws, kept where neighbours are at least `ratio` apart."""
    rng = np.random.default_rng(5)
    brute = np.sort(LogUniform(0.01, 1000.0).from_normal(rng.standard_normal((60000, 3))), axis=1)
    brute = brute[np.all(brute[:, 1:] / brute[:, :-1] >= ratio, axis=1)]
    theta = Prior(TAU, minimum_ratio=ratio).sample(rng, 20000)
    assert np.all(theta[:, 1:] / theta[:, :-1] >= ratio * (1.0 - 1e-12))
    for statistic in (lambda t: t[:, 0], lambda t: t[:, 1], lambda t: t[:, 2], lambda t: t.prod(1)):
        assert stats.ks_2samp(statistic(theta), statistic(brute)).pvalue > 1e-3
    assert stats.ks_2samp(theta[:, 1], brute[:, 1] * 1.15).pvalue < 1e-3


def test_ordered_uniform_and_log_normal_samples_match_sorting():
    rng = np.random.default_rng(6)
    brute = np.sort(Uniform(-5.0, 10.0).from_normal(rng.standard_normal((20000, 3))), axis=1)
    theta = Prior(ALPHA).sample(rng, 20000)
    for k in range(3):
        assert stats.ks_2samp(theta[:, k], brute[:, k]).pvalue > 1e-3
    brute = np.sort(LogNormal(10.0, 1.5).from_normal(rng.standard_normal((20000, 2))), axis=1)
    theta = Prior(RELAXATION).sample(rng, 20000)
    factor = np.sqrt(2.0)
    assert stats.ks_2samp(theta[:, 0], brute[:, 0] / factor).pvalue > 1e-3
    assert stats.ks_2samp(theta[:, 1], brute[:, 1] * factor).pvalue > 1e-3


def test_ordered_density_has_the_volume_of_the_gap():
    """n! / (log(upper/lower) - (n-1) log ratio)^n, times prod 1/tau."""
    prior = Prior(TAU, minimum_ratio=3.0)
    theta = np.array([[0.1, 1.0, 10.0]])
    width = np.log(1e5) - 2.0 * np.log(3.0)
    assert prior.log_density(theta)[0] == pytest.approx(np.log(6.0) - 3.0 * np.log(width))


def test_bounds_too_narrow_for_the_ratio_are_refused():
    with pytest.raises(UserError, match=r"tau: 3 values at least a factor 1000 apart do not fit"):
        Prior(TAU, minimum_ratio=1000.0)
