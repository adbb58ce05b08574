"""Hops between places in the order of units: the prior is kept, and far modes are found."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.statistical.units import chain_prior

from deabayes.prior.distributions import LogNormal
from deabayes.prior.joint import Prior
from deabayes.sampling.engine import sample
from deabayes.sampling.problem import Problem
from deabayes.study import Sampling
from deabayes.systems.ridges.units import UnitHop
from deabayes.systems.springs.ogden import Ogden


def film_prior(terms):
    """Ogden terms that are parts of one stress."""
    parameters = [
        replace(p, prior=LogNormal(1e6, 1.0), reference_stretches=(3.5, 0.06), part_of="stress")
        if p.half_product_with
        else p
        for p in Ogden().parameters(terms)
    ]
    return Prior.from_parameters(parameters)


PRIORS = {
    "two units": chain_prior(2),
    "three units": chain_prior(3),
    "moduli with priors of their own": chain_prior(2, own_prior=True),
    "Ogden terms": Prior.from_parameters(Ogden().parameters(2)),
    "terms of a film": film_prior(3),
}


def hopped(prior, hop, steps=15, size=20000):
    """Draws of N(0, I) after some accepted or refused hops, and the share accepted."""
    rng = np.random.default_rng(3)
    z = rng.standard_normal((size, len(prior.names)))
    accepted = 0.0
    for _ in range(steps):
        proposed, factor = hop(z, rng)
        ratio = factor + 0.5 * ((z**2).sum(axis=1) - (proposed**2).sum(axis=1))
        moved = np.log(rng.random(size)) < ratio
        z[moved] = proposed[moved]
        accepted += moved.mean() / steps
    return z, accepted


@pytest.mark.parametrize("stretches", [None, (2.0, 0.5**0.5)])
@pytest.mark.parametrize("name", PRIORS)
def test_a_hop_keeps_the_prior(name, stretches):
    z, accepted = hopped(PRIORS[name], UnitHop.of(PRIORS[name], stretches))
    assert accepted > 0.1
    p_values = [stats.kstest(column, "norm").pvalue for column in z.T]
    assert min(p_values) > 1e-4
    assert np.abs(np.corrcoef(z.T) - np.eye(z.shape[1])).max() < 0.035


def test_the_check_sees_a_hop_without_its_factor():
    prior = chain_prior(3)
    hop = UnitHop.of(prior)
    z, _ = hopped(prior, lambda z, rng: (hop(z, rng)[0], np.zeros(len(z))))
    assert min(stats.kstest(column, "norm").pvalue for column in z.T) < 1e-4


def test_a_hop_moves_modulus_and_time_together():
    prior = chain_prior(2)
    hop, rng = UnitHop.of(prior), np.random.default_rng(1)
    z = rng.standard_normal((500, 4))
    before, after = prior.to_parameters(z), prior.to_parameters(hop(z, rng)[0])
    swapped = np.isclose(after[:, 0], before[:, 1]) & np.isclose(after[:, 1], before[:, 0])
    kept = np.isclose(after[:, :2], before[:, :2]).all(axis=1)
    assert (swapped | kept).all()
    assert swapped.mean() > 0.1
    assert (np.isclose(after[swapped, 2], before[swapped, 3])
            | np.isclose(after[swapped, 3], before[swapped, 2])).all()  # fmt: skip


def test_a_hop_keeps_the_stress_of_an_ogden_term():
    prior = PRIORS["Ogden terms"]
    first, third = 3.0, 3.0**-0.5
    hop, rng = UnitHop.of(prior, (first, third)), np.random.default_rng(1)
    z = rng.standard_normal((500, 4))
    moved, factor = hop(z, rng)
    mu, alpha = np.split(prior.to_parameters(z), 2, axis=1)
    mu_after, alpha_after = np.split(prior.to_parameters(moved), 2, axis=1)
    before = np.sort(mu * (first**alpha - third**alpha), axis=1)
    after = np.sort(mu_after * (first**alpha_after - third**alpha_after), axis=1)
    np.testing.assert_allclose(after, before, rtol=1e-8)
    assert (~np.isclose(alpha_after, alpha)).any(axis=1).mean() > 0.99
    assert np.isfinite(factor).mean() > 0.95


def test_one_unit_has_no_hop():
    assert UnitHop.of(chain_prior(1)) is None


def test_both_numbers_of_the_only_visible_unit_are_found():
    """One unit of 1e5 Pa at 0.3 s is seen; the other, stiffer than 3e6 Pa, is seen nowhere.

    Of its prior on log tau from 0.01 to 10 s without the factor 2 about 0.3 s, the invisible
    unit is slower with probability log(10 / 0.6) / (log(10 / 0.6) + log(0.15 / 0.01)).
    """
    prior = chain_prior(2)

    def log_likelihood(z):
        moduli, times = np.split(prior.to_parameters(z), 2, axis=1)
        order = np.argsort(moduli, axis=1)
        (soft, stiff), (time, _) = (
            np.take_along_axis(values, order, axis=1).T for values in (moduli, times)
        )
        misfit = (np.log(soft / 2e5) / 0.02) ** 2 + (np.log(time / 0.3) / 0.02) ** 2
        soft_bound = np.maximum((np.log(1e6) - np.log(stiff)) / 0.05, 0.0)
        return -0.5 * misfit - 0.5 * soft_bound**2

    problem = Problem(log_likelihood, 4, hops=(UnitHop.of(prior),))
    found = sample(problem, Sampling(ess=2000.0), np.random.SeedSequence(2))
    assert found.convergence.converged, found.convergence.reasons
    theta = prior.to_parameters(found.chain.reshape(-1, 4))
    slower = np.log(10 / 0.6) / (np.log(10 / 0.6) + np.log(0.15 / 0.01))
    assert (theta[:, 0] < theta[:, 1]).mean() == pytest.approx(slower, abs=0.04)
