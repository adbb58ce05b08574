"""Fewer points that say as much: polylines, corners and overviews of long records."""

from __future__ import annotations

import numpy as np
from tests.shared.strip_records import relaxation

from deabayes.records.preparation.excitation import corners, polyline
from deabayes.records.preparation.prepared import thinned


def test_polyline_keeps_its_promise() -> None:
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.uniform(0.5, 1.5, 4000))
    walk = np.cumsum(rng.standard_normal(4000))
    for tolerance in (0.0, 0.5, 3.0, 20.0):
        knots = polyline(time, walk, tolerance)
        error = np.abs(np.interp(time, time[knots], walk[knots]) - walk)
        assert error.max() <= tolerance + 1e-9
    assert polyline(time, walk, 3.0).size < 0.3 * time.size


def test_polyline_follows_a_curve_that_jumps() -> None:
    """Knots of one coordinate, as `limit_current` leaves them at clock times."""
    time = np.array([0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 4.0, 5.0])
    values = np.array([0.0, 5.0, 5.0, 5.0, 5.01, 9.0, 8.0, 7.0, 7.05, 6.0])
    with np.errstate(all="raise"):
        assert polyline(time, values, 0.1).tolist() == [0, 1, 4, 5, 9]
    assert polyline(time, values, 0.0).tolist() == [0, 1, 3, 4, 5, 7, 8, 9]


def test_polyline_of_a_ramp_and_hold_has_few_knots() -> None:
    record = relaxation()
    assert polyline(record.columns["time"], record.columns["displacement"], 1e-6).size <= 7


def test_corners_stand_at_turns_and_jumps() -> None:
    record = relaxation()
    found = corners(record.columns["time"], record.columns["displacement"], 0.002, 0.01)
    assert np.allclose(found, [1.0, 3.0], atol=0.05)
    time = np.linspace(0.0, 10.0, 1001)
    jump = corners(time, np.where(time >= 5.0, 3.0, 0.0), 0.15, time[1] - time[0])
    assert jump.tolist() == [5.0]


def test_corners_are_found_on_a_thinned_excitation() -> None:
    """Its knots are neighbours in the array, not in time: a corner is no jump for that."""
    time = np.array([0.0, 2.0, 2.01, 6.0, 20.0])
    values = np.array([0.0, 0.0, 1.0, 3.0, 3.0])
    assert corners(time, values, 0.15, 0.01).tolist() == [2.01, 6.0]


def test_overview_keeps_extremes_within_its_limit() -> None:
    rng = np.random.default_rng(5)
    time = np.linspace(0.0, 1000.0, 50_000)
    response = rng.standard_normal(time.size)
    response[[30_000, 41_234]] = 50.0, -50.0
    masked = (time > 1.0) & (time < 1.2)
    kept = thinned(time, response, np.interp(time, [0, 2, 1000], [0, 1, 1]), masked)
    assert kept.size <= 2000
    assert {30_000, 41_234} <= set(kept.tolist())
    assert masked[kept].any()
    assert np.all(np.diff(kept) > 0)
