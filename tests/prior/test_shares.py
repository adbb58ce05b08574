"""Relaxation units of which a record shows the sum: what stays put where one of them is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared.coordinates import check_there_and_back, coordinates_of, parts_of
from tests.validation.membrane_worlds import membrane
from tests.validation.tubular_worlds import tubular_full

from deabayes.experiment import FloatArray
from deabayes.prior.coordinates import Natural
from deabayes.prior.distributions import LogUniform
from deabayes.prior.ordered import Ordered
from deabayes.sampling.problem import Coordinates
from deabayes.systems.ridges.units import (
    NestedShares,
    Parts,
    Shares,
    TooSlow,
    shown_for,
    unit_shares,
)

RECORD = 100.0
TIMES = LogUniform(1e-2, 1e6)
MEDIANS, SIGMAS = np.array([2.0, 3.0, 5.0]), np.array([0.5, 0.7, 0.9])


def units(count: int, sign: float = 1.0, spread: bool = False) -> Coordinates:
    """Times in the first columns of z, moduli (or, with -1, stiffnesses in series) in the last."""
    shares = Shares(
        tuple(range(count)),
        tuple(range(count, 2 * count)),
        sign * np.log(MEDIANS[:count]),
        sign * SIGMAS[:count],
        TooSlow(float(np.log(RECORD))),
        spread,
    )
    times = Natural(Ordered.of("tau", tuple(range(count)), TIMES, 1.0))
    return Coordinates((times, shares))


def at(moduli: list[float], times: list[float], sign: float = 1.0) -> FloatArray:
    """u of units given by what adds up and by their times."""
    count = len(moduli)
    there = units(count, sign)
    theta = np.array(times)[None]
    z = np.empty((1, 2 * count))
    z[:, :count] = there.parts[0].block.to_normal(theta)
    z[:, count:] = (sign * np.log(moduli) - np.log(MEDIANS[:count])) / SIGMAS[:count]
    return there.straighten(z)[0][0]


COUNT, TOO_SLOW = 4, TooSlow(float(np.log(20.0)))
NESTED_TIMES = LogUniform(1e-4, 1e4)
NESTED_MEDIANS = np.array([60.0, 8.0, 3.0, 1.0])
NESTED_SIGMAS = np.array([0.5, 0.7, 0.9, 1.1])
PLACES, SIZES = tuple(range(COUNT)), tuple(range(COUNT, 2 * COUNT))


def nested_units(sign: float = 1.0) -> Coordinates:
    """Four units, each against all slower ones: times in the first columns of z, then moduli."""
    shares = NestedShares(
        PLACES, SIZES, sign * np.log(NESTED_MEDIANS), sign * NESTED_SIGMAS, TOO_SLOW
    )
    return Coordinates((Natural(Ordered.of("tau", PLACES, NESTED_TIMES, 1.0)), shares))


def nested_at(moduli: list[float], times: list[float]) -> FloatArray:
    there = nested_units()
    z = np.empty((1, 2 * COUNT))
    z[:, :COUNT] = there.parts[0].block.to_normal(np.array(times)[None])
    z[:, COUNT:] = (np.log(moduli) - np.log(NESTED_MEDIANS)) / NESTED_SIGMAS
    return there.straighten(z)[0][0]


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("count", [2, 3])
def test_there_and_back_with_the_jacobian(count: int, sign: float, spread: bool) -> None:
    z = np.random.default_rng(1).standard_normal((300, 2 * count))
    check_there_and_back(units(count, sign, spread), z)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nested_units_there_and_back_with_the_jacobian(sign: float) -> None:
    z = np.random.default_rng(1).standard_normal((300, 2 * COUNT))
    check_there_and_back(nested_units(sign), z)


@pytest.mark.parametrize("count", [2, 3])
def test_the_spread_of_parts_is_the_standard_deviation_of_their_places(count: int) -> None:
    """var = sum_ik c_ik s_i s_k, c_ik the correlation of "beyond the i-th" and "the k-th"."""
    there = replace(units(count, spread=True).parts[1], hidden=np.zeros_like)
    z = np.random.default_rng(3).standard_normal((50, 2 * count))
    u = np.sort(z, axis=1)
    where = u[:, :count].copy()
    sizes = np.exp(there.intercepts + there.slopes * u[:, count:])
    shares = sizes / sizes.sum(axis=1, keepdims=True)
    mean = (shares * where).sum(axis=1, keepdims=True)
    variance = (shares * (where - mean) ** 2).sum(axis=1)
    there.straighten(u)
    below = np.cumsum(shares, axis=1)[:, :-1]
    odds = np.sqrt(below / (1.0 - below))
    i, roots = np.arange(count - 1), u[:, 1:count]
    correlation = odds[:, np.minimum.outer(i, i)] / odds[:, np.maximum.outer(i, i)]
    found = np.einsum("wi,wik,wk->w", roots, correlation, roots)
    np.testing.assert_allclose(found, variance)
    np.testing.assert_allclose(u[:, 0], mean[:, 0])


def test_shares_of_any_size_have_a_way_back() -> None:
    u = np.array([[0.0, 1.0, 1.0, 2.0, 900.0, -900.0], [0.0, 1.0, 1.0, 2.0, -900.0, 900.0]])
    assert np.isfinite(units(3).bend(u)).all()
    u = np.tile([0.0, 1.0, 1.0, 1.0, 2.0, 900.0, -900.0, 900.0], (2, 1))
    u[1, 5:] *= -1.0
    nested_units().parts[1].bend(u)
    assert np.isfinite(u).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_hidden_unit_moves_neither_sum_nor_mean_time(sign: float) -> None:
    """One unit of 1 and 5 s, and one that hardly is: before it, behind it, or sharing it."""
    total, mean = 2, 0
    seen = at([1.0, 1e-9], [5.0, 20.0], sign)
    before = at([1e-9, 1.0], [0.1, 5.0], sign)
    apart = np.log(5.0) + np.array([-0.7, 0.3]) * 0.2
    both = at([0.3, 0.7], np.exp(apart).tolist(), sign)
    for other in (before, both):
        assert other[total] == pytest.approx(seen[total], abs=0.01)
        assert other[mean] == pytest.approx(seen[mean], abs=0.01)
    assert seen[3] < -19.0 < 19.0 < before[3]


def test_a_unit_too_slow_for_the_record_keeps_its_share() -> None:
    """What is seen of it is mu / tau: the ridge along which both grow is a straight line."""
    slow = np.array([3e4, 1e5, 5e5])
    u = np.array([at([1.0, 1e-3 * tau], [5.0, tau]) for tau in slow])
    assert np.ptp(u[:, 2]) < 1e-3
    assert np.ptp(u[:, 3]) < 0.02
    slope = np.diff(u[:, 0]) / np.diff(u[:, 1])
    assert slope == pytest.approx(slope.mean(), rel=0.01)


def test_shares_of_real_candidates() -> None:
    chain, parallel = tubular_full().target(2), membrane().target(3)
    for target, sign in ((chain, -1.0), (parallel, 1.0)):
        (found,) = parts_of(target, Shares)
        z = np.random.default_rng(2).standard_normal((50, target.dimension))
        theta = target.prior.to_parameters(z)
        moduli, times = theta[:, list(found.sizes)], theta[:, list(found.places)]
        assert all(target.names[k].startswith("tau") for k in found.places)
        last = max(shown_for(r.experiment) for r in target.records)
        shown = moduli**sign / (1.0 + times / last)
        u, _ = coordinates_of(target).straighten(z)
        np.testing.assert_allclose(np.exp(u[:, found.sizes[0]]), shown.sum(axis=1))
        mean = (shown * np.log(times)).sum(axis=1) / shown.sum(axis=1)
        np.testing.assert_allclose(u[:, found.places[0]], mean, atol=1e-9)


def test_a_frequency_response_shows_a_unit_for_a_period() -> None:
    records = [record.experiment for record in tubular_full().target(2).records]
    shown = {e.coordinate_name: shown_for(e) for e in records}
    time, frequency = (
        next(e.coordinate for e in records if e.coordinate_name == name)
        for name in ("time", "frequency")
    )
    assert shown == {"time": time[-1] - time[0], "frequency": 1.0 / frequency[0]}
    assert shown_for(replace(records[0], coordinate_name="stretch")) == 0.0


def test_units_that_cannot_be_added_stay_as_they_are() -> None:
    assert parts_of(membrane().target(1), Shares) == []
    two = tubular_full().target(2)
    times = frozenset(k for k, name in enumerate(two.names) if name in ("tau_1", "tau_2"))
    records = [record.experiment for record in two.records]
    everything = frozenset(range(two.dimension))
    given = two.prior, records, two.system.units_add
    assert len(unit_shares(*given, everything)) == 1
    assert unit_shares(*given, everything - {min(times)}) == []
    assert unit_shares(two.prior, records, None, everything) == []
    drawn = two.prior.sample(np.random.default_rng(4), 500)
    stiffness = two.names.index("E_2")
    two = replace(two, prior=two.prior.inherit(["E_2"], drawn[:, [stiffness]]))
    assert parts_of(two, Shares) == []


def test_the_slow_two_trade_and_all_but_their_ratio_stays() -> None:
    """Sum, mean and standard deviation of ln tau of units 3 and 4 kept, and the first two."""
    u = []
    for share in (0.6, 0.75, 0.9):
        root = np.sqrt(share * (1.0 - share))
        times = np.exp(np.log(7.0) + 0.4 / root * np.array([share - 1.0, share]))
        moduli = 5.0 * np.array([share, 1.0 - share]) * (1.0 + times / 20.0)
        u.append(nested_at([66.0, 8.0, *moduli], [8.3e-3, 0.5, *times]))
    ratio = SIZES[3]
    kept = np.delete(np.array(u), ratio, axis=1)
    np.testing.assert_allclose(kept, np.tile(kept[0], (3, 1)), atol=1e-9)
    np.testing.assert_allclose(np.array(u)[:, ratio], np.log([0.6 / 0.4, 0.75 / 0.25, 9.0]))
    np.testing.assert_allclose(u[0][PLACES[3]], 0.4)


def test_two_nested_units_are_shares_with_their_spread() -> None:
    z = np.random.default_rng(2).standard_normal((50, 4))
    given = (0, 1), (2, 3), np.log(NESTED_MEDIANS[:2]), NESTED_SIGMAS[:2], TOO_SLOW
    u, expected = np.sort(z, axis=1), np.sort(z, axis=1)
    log_jacobian = NestedShares(*given).straighten(u)
    np.testing.assert_allclose(log_jacobian, Shares(*given, spread=True).straighten(expected))
    expected[:, 3] *= -1.0
    np.testing.assert_allclose(u, expected)


@pytest.mark.parametrize(("count", "kind"), [(3, Shares), (4, NestedShares)])
def test_from_four_units_on_they_are_nested(count: int, kind: type) -> None:
    (found,) = parts_of(membrane().target(count), Parts)
    assert type(found) is kind
