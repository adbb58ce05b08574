"""Edges of the bins a record is averaged in."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.preparation.polyline import corners, polyline
from deabayes.preparation.working import WorkingRecord

CORNER_FRACTION = 0.05
NOISE_FRACTION = 0.01
JUMP_FRACTION = 0.1
JUMP_RATIO = 20.0
ALONG_PATH = 5.0
LONGEST_GRID = 100_000
NEXT_SAMPLES = 9
"""Of which the sampling interval behind a corner is taken."""


def geometric_edges(
    record: WorkingRecord,
    first_width: float | None,
    ratio: float,
    widest: float,
    largest_change: float,
) -> FloatArray:
    """Ascending edges; bins start anew at every corner of the excitation.

    Parameters
    ----------
    first_width, widest : on the record's coordinate; None takes four sampling intervals.
    ratio : of neighbouring widths away from a corner.
    largest_change : how much of its range the excitation may travel within a bin.
    """
    last = float(record.coordinate[-1])
    interval = float(np.median(np.diff(record.coordinate)))
    turns = record_corners(record)
    starts = [float(min(record.coordinate[0], record.excitation_start())), *map(float, turns)]
    starts = sorted({start for start in starts if start < last})
    path = travel(record)
    edges: list[float] = []
    for start, end in zip(starts, [*starts[1:], np.nextafter(last, np.inf)], strict=True):
        edge = start
        first = (
            4.0 * _interval_behind(record, start, interval) if first_width is None else first_width
        )
        while edge < end and len(edges) < LONGEST_GRID:
            edges.append(edge)
            width = min(widest, first + (ratio - 1.0) * (edge - start))
            edge = min(edge + width, _after_travel(*path, edge, largest_change))
    if len(edges) == LONGEST_GRID:
        raise _too_many_bins(record, "first_width, widest or largest_change")
    return np.array([*edges, np.nextafter(last, np.inf)])


def record_corners(record: WorkingRecord) -> FloatArray:
    """Where the excitation turns."""
    interval = float(np.median(np.diff(record.coordinate)))
    tolerance = CORNER_FRACTION * record.excitation_range
    return corners(record.excitation_coordinate, record.excitation, tolerance, interval)


def _interval_behind(record: WorkingRecord, start: float, usual: float) -> float:
    """The sampling interval behind a corner, where it is clearly shorter than the usual one."""
    behind = record.coordinate[np.searchsorted(record.coordinate, start) :][:NEXT_SAMPLES]
    interval = float(np.median(np.diff(behind))) if behind.size > 1 else usual
    return interval if interval < 0.5 * usual else usual


def _too_many_bins(record: WorkingRecord, keys: str, found: str = "") -> UserError:
    return UserError(
        f"preparation of {record.row.name} ({record.row.protocol}), average: makes more than "
        f"{LONGEST_GRID} bins{found}; give a larger average.{keys}"
    )


def travel(record: WorkingRecord) -> tuple[FloatArray, FloatArray]:
    """Knots, and the path the excitation has gone up to each, in units of its range.

    Counted on a polyline within 1 % of the range, so that noise on a monitored
    voltage does not add up to a path.
    """
    size = record.excitation_range
    knots = polyline(record.excitation_coordinate, record.excitation, NOISE_FRACTION * size)
    steps = np.abs(np.diff(record.excitation[knots])) / (size or 1.0)
    return record.excitation_coordinate[knots], np.concatenate([[0.0], np.cumsum(steps)])


def _after_travel(knots: FloatArray, travelled: FloatArray, edge: float, change: float) -> float:
    """Where the excitation has gone `change` further than at `edge`; infinite if never."""
    target = float(np.interp(edge, knots, travelled)) + change
    if target >= travelled[-1]:
        return np.inf
    upper = int(np.searchsorted(travelled, target, side="left"))
    share = (target - travelled[upper - 1]) / (travelled[upper] - travelled[upper - 1])
    reached = float(knots[upper - 1] + share * (knots[upper] - knots[upper - 1]))
    return max(reached, float(np.nextafter(edge, np.inf)))


def uniform_edges(record: WorkingRecord, first: float, last: float, width: float) -> FloatArray:
    """Edges `width` apart within [first, last], and one at every jump of the excitation."""
    bins = max(int(np.ceil((last - first) / width * (1.0 - 1e-12))), 1)
    if bins > LONGEST_GRID:
        raise _too_many_bins(record, "width, or fewer points", f" ({bins})")
    edges = first + width * np.arange(bins)
    edges = np.append(edges, np.nextafter(max(last, float(edges[-1])), np.inf))
    inside = [jump for jump in jumps(record) if first < jump < last]
    return np.union1d(edges, inside)


def jumps(record: WorkingRecord) -> FloatArray:
    """Coordinates right after a jump, by 10 % of the excitation's range.

    It is 20 times as fast as the range over the record's length, and five times as fast as the
    excitation is on average along its path: a sine of more than six cycles has the first pace on
    its own, of which its straight pieces or few samples are no jumps.
    """
    size = record.excitation_range
    change = np.abs(np.diff(record.excitation))
    knots, path = travel(record)
    usual = size * max(JUMP_RATIO, ALONG_PATH * float(path[-1])) / (knots[-1] - knots[0])
    fast = change > usual * np.diff(record.excitation_coordinate)
    return record.excitation_coordinate[1:][fast & (change > JUMP_FRACTION * size)]
