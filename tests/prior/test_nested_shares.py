"""Each unit against all slower ones together: what stays put where small units trade."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.coordinates import check_there_and_back, parts_of
from tests.validation.membrane_worlds import membrane

from deabayes.experiment import FloatArray
from deabayes.prior.coordinates import Natural
from deabayes.prior.distributions import LogUniform
from deabayes.prior.ordered import Ordered
from deabayes.sampling.problem import Coordinates
from deabayes.systems.ridges.units import NestedShares, Parts, Shares, TooSlow

COUNT, TOO_SLOW = 4, TooSlow(float(np.log(20.0)))
TIMES = LogUniform(1e-4, 1e4)
MEDIANS, SIGMAS = np.array([60.0, 8.0, 3.0, 1.0]), np.array([0.5, 0.7, 0.9, 1.1])
PLACES, SIZES = tuple(range(COUNT)), tuple(range(COUNT, 2 * COUNT))


def units(sign: float = 1.0) -> Coordinates:
    """Four, the times in the first columns of z, moduli in the last."""
    shares = NestedShares(PLACES, SIZES, sign * np.log(MEDIANS), sign * SIGMAS, TOO_SLOW)
    return Coordinates((Natural(Ordered.of("tau", PLACES, TIMES, 1.0)), shares))


def at(moduli: list[float], times: list[float]) -> FloatArray:
    there = units()
    z = np.empty((1, 2 * COUNT))
    z[:, :COUNT] = there.parts[0].block.to_normal(np.array(times)[None])
    z[:, COUNT:] = (np.log(moduli) - np.log(MEDIANS)) / SIGMAS
    return there.straighten(z)[0][0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_there_and_back_with_the_jacobian(sign: float) -> None:
    check_there_and_back(units(sign), np.random.default_rng(1).standard_normal((300, 2 * COUNT)))


def test_the_slow_two_trade_and_all_but_their_ratio_stays() -> None:
    """Sum, mean and standard deviation of ln tau of units 3 and 4 kept, and the first two."""
    u = []
    for share in (0.6, 0.75, 0.9):
        root = np.sqrt(share * (1.0 - share))
        times = np.exp(np.log(7.0) + 0.4 / root * np.array([share - 1.0, share]))
        moduli = 5.0 * np.array([share, 1.0 - share]) * (1.0 + times / 20.0)
        u.append(at([66.0, 8.0, *moduli], [8.3e-3, 0.5, *times]))
    ratio = SIZES[3]
    kept = np.delete(np.array(u), ratio, axis=1)
    np.testing.assert_allclose(kept, np.tile(kept[0], (3, 1)), atol=1e-9)
    np.testing.assert_allclose(np.array(u)[:, ratio], np.log([0.6 / 0.4, 0.75 / 0.25, 9.0]))
    np.testing.assert_allclose(u[0][PLACES[3]], 0.4)


def test_two_nested_units_are_shares_with_their_spread() -> None:
    z = np.random.default_rng(2).standard_normal((50, 4))
    given = (0, 1), (2, 3), np.log(MEDIANS[:2]), SIGMAS[:2], TOO_SLOW
    u, expected = np.sort(z, axis=1), np.sort(z, axis=1)
    log_jacobian = NestedShares(*given).straighten(u)
    np.testing.assert_allclose(log_jacobian, Shares(*given, spread=True).straighten(expected))
    expected[:, 3] *= -1.0
    np.testing.assert_allclose(u, expected)


def test_shares_of_any_size_have_a_way_back() -> None:
    u = np.tile([0.0, 1.0, 1.0, 1.0, 2.0, 900.0, -900.0, 900.0], (2, 1))
    u[1, 5:] *= -1.0
    units().parts[1].bend(u)
    assert np.isfinite(u).all()


@pytest.mark.parametrize(("count", "kind"), [(3, Shares), (4, NestedShares)])
def test_from_four_units_on_they_are_nested(count: int, kind: type) -> None:
    (found,) = parts_of(membrane().target(count), Parts)
    assert type(found) is kind
