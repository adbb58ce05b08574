"""Particles carried to a peak that none of them saw."""

from dataclasses import replace

import numpy as np
import pytest
from tests.statistical.test_climb import population

from deabayes.sampling.carrying import (
    FEW,
    HIGHER,
    WIDER,
    WIDEST,
    carried,
    displaced,
    higher_peak,
    joined,
)
from deabayes.sampling.climb import Peak, find_peaks
from deabayes.sampling.cloud import Schedule
from deabayes.sampling.first_pass import _onto_the_bulk
from deabayes.sampling.guide import Guide
from deabayes.sampling.run import Target
from deabayes.sampling.smc import log_standard_normal

BEND = 0.8


def two_times(z, higher=100.0):
    """A peak about 0.5 of the first column and a thin one about -1.2, where the rest is wider.

    The others are a ridge, bent over three standard deviations of the prior.
    """
    broad = -0.5 * (((z[:, 0] - 0.5) / 0.3) ** 2 + ((z[:, 3] - 0.2) / 0.02) ** 2)
    thin = higher + 4.0 - 4.0 * np.hypot(1.0, (z[:, 0] + 1.2) / 0.02)
    thin -= 0.5 * ((z[:, 3] - 0.2) / 0.3) ** 2
    ridge = -0.5 * (z[:, 1] ** 2 + ((z[:, 2] - BEND * z[:, 1] ** 2) / 0.05) ** 2)
    return np.logaddexp(broad, thin) + ridge


def on_the_ridge(rng, size, first, width, last):
    z = rng.standard_normal((size, 4))
    z[:, 0] = first + width * z[:, 0]
    z[:, 2] = BEND * z[:, 1] ** 2 + 0.05 * z[:, 2]
    z[:, 3] = 0.2 + last * z[:, 3]
    return z


def log_evidence(width, last):
    """Of a normal peak of height 0 and these widths, on the ridge."""
    return np.log((2 * np.pi) ** 2 * width * 0.05 * last)


def shifted(z):
    return z + np.array([[-2.5], [-1.7], [1.5]]) * np.array([1.0, 0.0, 0.0, 0.0])


def begun(seed=1, target=two_times):
    rng = np.random.default_rng(seed)
    particles = on_the_ridge(rng, 600, 0.5, 0.3, 0.02)
    gathered = replace(
        population(particles, target), early=particles, log_evidence=log_evidence(0.3, 0.02)
    )
    return gathered, max(find_peaks(target, gathered, rng), key=lambda peak: peak.log_density)


def test_the_peak_of_another_place_is_found():
    gathered, best = begun()
    assert best.z[0] == pytest.approx(0.5, abs=0.05)
    higher = higher_peak(two_times, best, gathered.factor, shifted)
    assert higher is not None
    assert higher.z[0] == pytest.approx(-1.2, abs=0.01)
    assert higher.log_density > best.log_density + 95.0


def test_of_many_places_the_most_promising_are_climbed_from():
    def many(z):
        useless = np.tile(z + np.array([1.5, 0.0, 0.0, 0.0]), (2 * FEW, 1))
        return np.concatenate([useless, shifted(z)])

    gathered, best = begun()
    higher = higher_peak(two_times, best, gathered.factor, many)
    assert higher is not None
    assert higher.z[0] == pytest.approx(-1.2, abs=0.01)


@pytest.mark.parametrize("places", [lambda z: z[None], lambda z: np.empty((0, 4))])
def test_where_climbs_come_back_or_none_begins_there_is_none(places):
    gathered, best = begun()
    assert higher_peak(two_times, best, gathered.factor, places) is None


@pytest.mark.parametrize(("level", "found"), [(HIGHER - 1.0, False), (HIGHER + 1.0, True)])
def test_it_must_be_higher_than_climbs_scatter(level, found):
    def target(z):
        return two_times(z, level)

    gathered, best = begun(target=target)
    peak = higher_peak(target, best, gathered.factor, shifted)
    assert (peak is not None) == found


def test_particles_are_displaced_by_the_way_and_widened_up_to_the_prior():
    gathered, best = begun()
    peak = higher_peak(two_times, best, gathered.factor, shifted)
    z = displaced(two_times, gathered, peak, np.random.default_rng(6))
    before = gathered.particles
    np.testing.assert_allclose(z.mean(axis=0) - before.mean(axis=0), peak.z - best.z, atol=0.15)
    added = np.sqrt(z.var(axis=0) - before.var(axis=0))
    assert added[0] == pytest.approx(WIDER * 0.01, rel=0.3)
    assert added[3] == pytest.approx(WIDEST, rel=0.1), "four times 0.3 is more than the prior"


def test_carried_particles_keep_the_ridge_and_take_the_width_of_the_peak():
    gathered, best = begun()
    peak = higher_peak(two_times, best, gathered.factor, shifted)
    rng = np.random.default_rng(7)
    moved = carried(two_times, gathered, peak, rng, Schedule(), Guide())
    exact = on_the_ridge(rng, 20000, -1.2, 0.01, 0.3)
    z = moved.particles
    assert np.median(z[:, 0]) == pytest.approx(-1.2, abs=0.003)
    for column in (1, 3):
        assert z[:, column].mean() == pytest.approx(
            exact[:, column].mean(), abs=0.25 * exact[:, column].std()
        )
        assert z[:, column].std() / exact[:, column].std() == pytest.approx(1.0, abs=0.2)
    off = z[:, 2] - BEND * z[:, 1] ** 2
    assert off.std() == pytest.approx(0.05, rel=0.15)
    np.testing.assert_allclose(moved.log_density, two_times(z), rtol=1e-9)


@pytest.mark.parametrize(("ratio", "share"), [(0.0, 0.5), (2.0, 0.881), (-50.0, 0.0), (50.0, 1.0)])
def test_populations_are_joined_by_their_evidence(ratio, share):
    rng = np.random.default_rng(9)
    here, there = (
        population(on_the_ridge(rng, 500, first, 0.1, 0.1), two_times) for first in (0.5, 5.0)
    )
    both = joined(here, replace(there, log_evidence=ratio), rng)
    assert np.mean(both.particles[:, 0] > 3.0) == pytest.approx(share, abs=1 / 500)
    assert np.mean(both.broad[:, 0] > 3.0) == pytest.approx(share, abs=1 / 500)
    np.testing.assert_allclose(both.log_density, two_times(both.particles))


@pytest.mark.parametrize("level", [5.0, 13.0])
def test_a_higher_peak_gets_the_share_that_its_mass_has(level):
    """Away from a tie: evidences of so few particles are a nat or two too low."""
    widths = {"here": (0.3, 0.02), "there": (0.001, 0.001)}

    def normal(z, mean, width, last):
        return -0.5 * (((z[:, 0] - mean) / width) ** 2 + ((z[:, 3] - 0.2) / last) ** 2)

    def target(z):
        thin = level + normal(z, -1.2, *widths["there"])
        ridge = -0.5 * (z[:, 1] ** 2 + ((z[:, 2] - BEND * z[:, 1] ** 2) / 0.05) ** 2)
        return np.logaddexp(normal(z, 0.5, *widths["here"]), thin) + ridge

    gathered, _ = begun(target=target)
    peak = Peak(np.array([-1.2, 0.0, 0.0, 0.2]), level, np.diag([0.001, 1.0, 0.05, 0.001]))
    found = carried(target, gathered, peak, np.random.default_rng(10), Schedule(), Guide())
    ratio = level + log_evidence(*widths["there"]) - log_evidence(*widths["here"])
    share = np.mean(found.particles[:, 0] < -0.8)
    assert share == pytest.approx(1.0 / (1.0 + np.exp(-ratio)), abs=0.15)


@pytest.mark.parametrize(("elsewhere", "first"), [(None, 0.5), (shifted, -1.2)])
def test_the_warm_up_looks_where_its_guide_tells_it_to(elsewhere, first):
    def likelihood(z):
        return two_times(z) - log_standard_normal(z)

    gathered, _ = begun()
    target = Target(likelihood, Guide(elsewhere=elsewhere))
    found = _onto_the_bulk(target, gathered, np.random.default_rng(8))
    assert np.median(found["particles"][:, 0]) == pytest.approx(first, abs=0.06)
    np.testing.assert_allclose(found["log_posterior"], two_times(found["particles"]), rtol=1e-9)
