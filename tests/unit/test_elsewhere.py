"""Places with one relaxation unit at another time constant: where climbs to other peaks begin."""

from itertools import pairwise

import numpy as np
import pytest

from deabayes.distributions import LogNormal, LogUniform
from deabayes.parameter import Parameter
from deabayes.prior.joint import Prior
from deabayes.sampling.elsewhere import STRENGTHS, Elsewhere
from deabayes.springs.ogden import Ogden


def chain_prior(units, minimum_ratio):
    moduli = [
        Parameter(f"k_{i}", "k", "N/m", "", LogNormal(5.0, 2.0), "", belongs_to=f"tau_{i}")
        for i in range(1, units + 1)
    ]
    times = [
        Parameter(f"tau_{i}", "tau", "s", "", LogUniform(1e-3, 1e3), "", ordered="tau")
        for i in range(1, units + 1)
    ]
    return Prior([*moduli, *times], minimum_ratio)


def places(units, theta, minimum_ratio=2.0):
    prior = chain_prior(units, minimum_ratio)
    z = prior.to_normal(np.array([theta]))[0]
    return prior.to_parameters(Elsewhere.of(prior)(z))


def test_a_single_unit_is_taken_to_places_a_fifth_of_the_prior_apart():
    found = places(1, [2.0, 0.25])
    expected = np.repeat(1e-3 * 1e6 ** np.array([0.1, 0.3, 0.5, 0.7, 0.9]), len(STRENGTHS))
    np.testing.assert_allclose(found[:, 1], expected)
    np.testing.assert_allclose(found[:, 0], np.tile(2.0 * np.array(STRENGTHS), 5))


def test_what_belongs_to_a_unit_goes_along_and_the_others_stay():
    strengths, times = [60.0, 0.05, 4.0], [0.01, 0.2, 5.0]
    for row in places(3, [*strengths, *times]):
        here = set(zip(row[:3].round(9), row[3:].round(9), strict=True))
        kept = here & set(zip(strengths, times, strict=True))
        assert len(kept) == 2
        (moved,) = here - kept
        (gone,) = set(zip(strengths, times, strict=True)) - kept
        assert np.isclose(moved[0] / gone[0], STRENGTHS).any()
        assert list(row[3:]) == sorted(row[3:])


@pytest.mark.parametrize("units", [1, 2, 4])
def test_every_gap_between_other_units_has_a_place(units):
    times = 1e-3 * 1e6 ** ((np.arange(units) + 0.5) / units)
    found = places(units, [*(5.0 + np.arange(units)), *times])
    for unit in range(units):
        others = np.delete(times, unit)
        is_other = np.isclose(found[:, units:, None], others).any(axis=2)
        moved = found[:, units:][~is_other & (is_other.sum(axis=1, keepdims=True) == units - 1)]
        for low, high in pairwise([1e-3, *others, 1e3]):
            assert ((moved > low) & (moved < high)).any()


def test_places_closer_than_the_prior_allows_are_left_out():
    found = places(2, [5.0, 5.0, 0.1, 10.0], minimum_ratio=30.0)
    assert len(found)
    assert (found[:, 3] / found[:, 2] >= 30.0).all()


def test_a_prior_without_time_constants_has_none():
    assert Elsewhere.of(Prior.from_parameters(Ogden().parameters(2))) is None
