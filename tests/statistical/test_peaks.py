"""Climbs of many starts at once, and the curvature at the peaks they find."""

import numpy as np
import pytest
from tests.shared.densities import LeastSquares, OfNoPoint

from deabayes.sampling.peaks import climb, fisher_factors, peaks, triangular
from deabayes.sampling.problem import EveryDrawFailed, Split, Target

DIMENSION = 6
MEAN = np.linspace(-1.0, 1.0, DIMENSION)
FACTOR = np.tril(np.random.default_rng(0).standard_normal((DIMENSION, DIMENSION))) * 0.05
FACTOR += np.diag(np.geomspace(0.002, 0.3, DIMENSION))
INVERSE = np.linalg.inv(FACTOR)
INFORMATION = INVERSE.T @ INVERSE + np.eye(DIMENSION)
TOP = np.linalg.solve(INFORMATION, INVERSE.T @ INVERSE @ MEAN)
"""Mean and factor of a likelihood; what it makes of the prior N(0, I)."""


def thin_scores(z):
    return (z - MEAN) @ INVERSE.T


def valley_scores(z):
    """Rosenbrock's in two planes, scaled, ten and thirty times as steep across as along."""
    x, y = 2.0 * z[:, [0, 2]], np.array([1.0, 3.0]) * z[:, [1, 3]]
    return 10.0 * np.concatenate([x - 1.0, np.sqrt([1e2, 1e3]) * (y - x**2)], axis=1)


thin_normal, valley = LeastSquares(thin_scores, 7.0), LeastSquares(valley_scores)
PEAK = np.array([0.5, 1.0, 0.5, 1.0 / 3.0])
"""Of the valley, where the prior is next to nothing."""


def climbed(target, starts, iterations=80):
    every = np.tile(np.eye(starts.shape[1]), (len(starts), 1, 1))
    climbs = climb(target, starts, every, iterations)
    return climbs.x, climbs.value


def test_climbs_follow_a_curved_valley_to_its_maximum():
    starts = np.random.default_rng(1).standard_normal((8, 4))
    z, value = climbed(valley, starts)
    np.testing.assert_allclose(value, valley(PEAK[None])[0], atol=0.1)
    np.testing.assert_allclose(z, np.tile(PEAK, (8, 1)), atol=0.05)
    np.testing.assert_allclose(value, valley(z))


def test_climbs_in_lockstep_are_the_climbs_alone():
    starts = np.random.default_rng(2).standard_normal((5, 4))
    together, _ = climbed(valley, starts, 20)
    alone = [climbed(valley, starts[[k]], 20)[0][0] for k in range(5)]
    np.testing.assert_allclose(together, alone, atol=1e-9)


def test_climbs_that_fail_do_not_change_the_others():
    """Some climbs begin where the density fails, others beside a wall that they meet."""

    def scores(z):
        return np.where(z[:, :1] > MEAN[0] + 0.5, np.nan, thin_scores(z))

    walled = LeastSquares(scores, 7.0)
    starts = MEAN + 0.3 * np.random.default_rng(3).standard_normal((12, DIMENSION))
    starts[:3, 0] = MEAN[0] + 2.0
    starts[3:6, 0] = MEAN[0] + 0.499
    together, lost = climbed(walled, starts, 20)
    assert (np.isfinite(lost) == (np.arange(12) >= 3)).all()
    without, _ = climbed(walled, starts[3:], 20)
    np.testing.assert_allclose(together[3:], without, atol=1e-9)
    z, value = climbed(walled, starts[3:])
    np.testing.assert_allclose(value, walled(TOP[None])[0], atol=0.02)
    np.testing.assert_allclose(z, np.tile(TOP, (9, 1)), atol=0.1)


@pytest.mark.parametrize("off", [0.0, 0.3])
def test_the_fisher_factor_of_a_normal_is_its_covariance(off):
    """At its peak and beside it, from coordinates that know nothing of it."""
    place = TOP + off * FACTOR.sum(axis=1)
    (factor,) = fisher_factors(thin_normal, place[None], np.eye(DIMENSION)[None])
    assert np.array_equal(factor, np.tril(factor)) and (np.diag(factor) > 0.0).all()
    np.testing.assert_allclose(factor.T @ INFORMATION @ factor, np.eye(DIMENSION), atol=0.02)


def test_the_fisher_factor_of_a_scale_is_that_of_a_normal_law():
    """Fifty residuals r e^-c, all as large as they should be: twice as much for c as for a mean."""
    residuals = np.where(np.arange(50) % 2, 1.0, -1.0)

    class Scale(LeastSquares):
        def split(self, z):
            scores = (residuals - z[:, :1]) * np.exp(-z[:, 1:])
            return Split(scores, np.tile(z[:, 1:], 50), np.zeros(len(z)))

    (factor,) = fisher_factors(Scale(None), np.zeros((1, 2)), np.eye(2)[None], differences=1e-4)
    np.testing.assert_allclose(factor @ factor.T, np.diag([1 / 51, 1 / 101]), rtol=1e-3, atol=1e-6)


def test_no_direction_is_wider_than_the_prior():
    flat = LeastSquares(lambda z: np.stack([z[:, 0] / 0.1, 1e-3 * z[:, 1]], axis=1))
    (factor,) = fisher_factors(flat, np.zeros((1, 2)), np.eye(2)[None])
    np.testing.assert_allclose(factor @ factor.T, np.diag([1 / 101, 1.0]), rtol=0.02, atol=1e-4)


def test_a_direction_a_billion_times_thinner_than_another_has_a_factor():
    directions = np.linalg.qr(np.random.default_rng(8).standard_normal((3, 3)))[0]
    (factor,) = triangular((directions * np.array([1.0, 1e-5, 1e-10]))[None])
    assert np.array_equal(factor, np.tril(factor))
    assert (np.diag(factor) > 0.0).all()
    assert np.prod(np.diag(factor)) == pytest.approx(1e-15, rel=1e-4)


def test_fisher_factors_of_many_points_are_those_of_each():
    places = np.random.default_rng(9).standard_normal((4, 4))
    every = np.tile(np.eye(4), (4, 1, 1))
    together = fisher_factors(valley, places, every)
    alone = [fisher_factors(valley, places[[k]], every[:1])[0] for k in range(4)]
    np.testing.assert_allclose(together, alone, rtol=1e-6, atol=1e-9)


def test_the_highest_peak_comes_first():
    found = peaks(thin_normal, DIMENSION, np.random.default_rng(4))
    assert (np.diff(found.value) <= 0.0).all()
    np.testing.assert_allclose(found.value[0], thin_normal(TOP[None])[0], atol=0.01)
    factor = found.factors[0]
    np.testing.assert_allclose(factor.T @ INFORMATION @ factor, np.eye(DIMENSION), atol=0.02)


def test_climbs_also_start_from_draws_of_a_similar_posterior():
    """A needle that no climb from the prior finds."""

    def needle(z):
        return -0.5 * (((z - 2.5) / 0.01) ** 2).sum(axis=1)

    def two(z):
        return np.logaddexp(-0.5 * (z**2).sum(axis=1), 40.0 + needle(z))

    def found(similar):
        return peaks(OfNoPoint(two), 4, np.random.default_rng(3), similar).value[0]

    assert found(None) < 1.0 and found(np.full((3, 4), 2.49)) > 39.0


def test_waves_continue_until_some_climbs_end_at_the_highest_peak(monkeypatch):
    """A narrow peak that one climb in a hundred finds, on a broad one that each finds."""
    calls = []

    def needle(z):
        calls.append(len(z))
        near = -0.5 * (((z - 1.2) / 0.03) ** 2).sum(axis=1)
        return np.logaddexp(-0.5 * (z**2).sum(axis=1), 40.0 + near)

    monkeypatch.setattr("deabayes.sampling.peaks.CONFIRMED", 1)
    peaks(OfNoPoint(needle), 4, np.random.default_rng(3))
    once = sum(calls)
    calls.clear()
    monkeypatch.setattr("deabayes.sampling.peaks.CONFIRMED", 1000)
    peaks(OfNoPoint(needle), 4, np.random.default_rng(3))
    assert sum(calls) > 2.5 * once


@pytest.mark.parametrize(("below", "kept"), [(0.0, 2), (5.0, 2), (30.0, 1)])
def test_a_lower_peak_is_kept_unless_it_is_far_below(below, kept):
    """Of 64 climbs half reach each, so that the 16 highest alone would be of the higher one."""

    def two(z):
        first, second = (-0.5 * (((z - at) / 0.05) ** 2).sum(axis=1) for at in (-1.0, 1.0))
        return np.logaddexp(first, second - below)

    found = peaks(OfNoPoint(two), 3, np.random.default_rng(6))
    signs = np.sign(found.z[:, 0])
    assert len(np.unique(signs)) == kept and -1.0 in signs
    np.testing.assert_allclose(np.abs(found.z), 1.0, atol=0.02)


def test_a_density_of_zero_at_every_start_is_an_error():
    with pytest.raises(EveryDrawFailed):
        peaks(Target(lambda z: np.full(len(z), -np.inf)), 3, np.random.default_rng(7))


def test_few_starts_with_a_density_are_enough():
    """A corner that three of a hundred draws of the prior are in."""

    def scores(z):
        return np.where((z[:, :2] > 0.9).all(axis=1)[:, None], thin_scores(z - 2.5), np.nan)

    found = peaks(LeastSquares(scores), DIMENSION, np.random.default_rng(8))
    np.testing.assert_allclose(found.z, np.tile(MEAN + 2.5, (len(found.z), 1)), atol=0.4)


@pytest.mark.filterwarnings("error")
def test_infinite_derivatives_do_not_stop_climbs():
    """Derivatives whose squares are no numbers any more."""

    def scores(z):
        steep = np.where(z[:, :1] > 0.5, 1e152 * np.sin(1e6 * z[:, :1]), 0.0)
        return np.concatenate([z / 0.1, steep], axis=1)

    found = peaks(LeastSquares(scores), 3, np.random.default_rng(5))
    np.testing.assert_allclose(found.z[0], 0.0, atol=0.05)
    assert np.isfinite(found.factors).all()
