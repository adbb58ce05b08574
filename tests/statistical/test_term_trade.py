"""Terms that trade places and shares: the prior is kept, and a cusp is left again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.statistical.test_unit_hop import hopped
from tests.unit.test_film_moments import handed_on

from deabayes.distributions import LogNormal, Uniform
from deabayes.prior.joint import Prior
from deabayes.sampling.film_moments import slope_of
from deabayes.sampling.guide import Guide
from deabayes.sampling.term_trade import TermTrade
from deabayes.sampling.unit_hop import UnitHop
from deabayes.springs.ogden import Ogden, stress_of_one

LOGARITHMS = (float(np.log(3.5)), float(np.log(0.06)))
TERMS = {3: ((3, 4, 5), (0, 1, 2)), 4: ((4, 5, 6, 7), (0, 1, 2, 3))}


def film_prior(terms):
    """Ogden terms that are parts of one stress, with exponents from 0 to 5."""
    parameters = [
        replace(p, prior=LogNormal(1e6, 1.0), reference_stretches=(3.5, 0.06), part_of="stress")
        if p.half_product_with
        else replace(p, prior=Uniform(0.0, 5.0))
        for p in Ogden().parameters(terms)
    ]
    return Prior.from_parameters(parameters)


def trade_of(terms):
    prior = film_prior(terms)
    return prior, TermTrade(prior, *TERMS[terms], LOGARITHMS)


@pytest.mark.parametrize("terms", [3, 4])
def test_a_trade_keeps_the_prior(terms):
    prior, trade = trade_of(terms)
    z, accepted = hopped(prior, trade)
    assert accepted > 0.1
    p_values = [stats.kstest(column, "norm").pvalue for column in z.T]
    assert min(p_values) > 1e-4
    assert np.abs(np.corrcoef(z.T) - np.eye(z.shape[1])).max() < 0.035


def test_a_trade_without_its_factor_would_be_seen():
    prior, trade = trade_of(3)
    z, _ = hopped(prior, lambda z, rng: (trade(z, rng)[0], np.zeros(len(z))))
    assert min(stats.kstest(column, "norm").pvalue for column in z.T) < 1e-6


def test_a_trade_keeps_the_stress_and_its_slope():
    prior, trade = trade_of(4)
    rng = np.random.default_rng(5)
    z = rng.standard_normal((500, len(prior.names)))
    proposed, factor = trade(z, rng)
    moved = np.isfinite(factor) & (proposed != z).any(axis=1)
    assert moved.sum() > 100
    height = 0.5 * (LOGARITHMS[0] - LOGARITHMS[1])

    def shown(scores):
        theta = prior.to_parameters(scores[moved])
        exponents, coefficients = theta[:, TERMS[4][0]], theta[:, TERMS[4][1]]
        stresses = coefficients * stress_of_one(exponents, *LOGARITHMS)
        slope = (stresses * slope_of(exponents, height)[0]).sum(axis=1)
        return np.stack([stresses.sum(axis=1), slope])

    np.testing.assert_allclose(shown(proposed), shown(z), rtol=1e-7)


def test_a_gap_of_almost_nothing_is_left_again():
    """Records that know the stress at several stretches to 1e-4 forgive any small gap."""
    prior, trade = trade_of(3)
    rng = np.random.default_rng(6)
    theta = np.tile([3e5, 2e5, 1e3, 1.0, 1.0 + 1e-5, 4.0], (200, 1))
    z = prior.to_normal(theta)
    heights = np.log([3.0, 3.5, 4.0, 4.5])[:, None, None]

    def log_density(scores):
        now = prior.to_parameters(scores)
        curve = (now[:, :3] * stress_of_one(now[:, 3:], heights, -2.0 * heights)).sum(axis=2)
        then = (theta[:, :3] * stress_of_one(theta[:, 3:], heights, -2.0 * heights)).sum(axis=2)
        return -0.5 * np.sum(((curve / then - 1.0) / 1e-4) ** 2, axis=0) - 0.5 * np.sum(
            scores**2, axis=1
        )

    for _ in range(100):
        proposed, factor = trade(z, rng)
        moved = np.log(rng.random(200)) < factor + log_density(proposed) - log_density(z)
        z[moved] = proposed[moved]
    found = prior.to_parameters(z)
    assert np.mean(found[:, 4] - found[:, 3] > 1e-3) > 0.9


def test_it_is_of_films_handed_on():
    kinds = [type(hop) for hop in Guide.of(handed_on()).hops]
    assert kinds == [UnitHop, TermTrade]
