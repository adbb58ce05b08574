"""Polylines: a sampled curve as few straight pieces, with a bound on the error."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.records.preparation.working import IntArray


def polyline(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Return indices of samples joined by straight lines within `tolerance` of all samples.

    From each knot, the slopes that pass all following samples within the tolerance form a
    narrowing cone. The next knot is the last sample within the cone of all samples before it.
    This is the cone intersection method of Sklansky and Gonzalez (1980), with errors measured
    along `values`. It passes through the record once.

    Parameters
    ----------
    coordinate, values : (M,) samples; the coordinate never descends, and where it repeats, the
        curve jumps.
    tolerance : largest allowed |line - sample|, in the unit of `values`.

    Returns
    -------
    (K,) ascending indices, which include the first and the last sample.
    """
    x, y = coordinate.tolist(), values.tolist()
    knots = [0]
    while knots[-1] < len(x) - 1:
        knots.append(_furthest(x, y, knots[-1], tolerance))
    return np.array(knots, dtype=np.intp)


def _furthest(x: list[float], y: list[float], start: int, tolerance: float) -> int:
    """Last sample that a line from `start` reaches while all between are within tolerance."""
    x0, y0 = x[start], y[start]
    low, high = -np.inf, np.inf
    reached = start + 1
    for index in range(start + 1, len(x)):
        run, rise = x[index] - x0, y[index] - y0
        if run == 0.0:
            if abs(rise) > tolerance:
                break
            reached = index
            continue
        if low <= rise / run <= high:
            reached = index
        low = max(low, (rise - tolerance) / run)
        high = min(high, (rise + tolerance) / run)
        if low > high:
            break
    return reached


def corners(
    coordinate: FloatArray, values: FloatArray, tolerance: float, interval: float
) -> FloatArray:
    """Return the coordinates where an excitation turns: ramp ends, steps, peaks of triangles.

    These are the inner `turns`. A jump within one sampling `interval` has two turns; only the
    later counts as a corner.
    """
    knots = turns(coordinate, values, tolerance)
    inner = coordinate[knots[1:-1]]
    before_jump = np.diff(coordinate[knots[1:]]) <= 1.5 * interval
    return inner[~before_jump]


def turns(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Indices of a Ramer-Douglas-Peucker polyline (Douglas and Peucker 1973) within `tolerance`.

    Unlike the knots of `polyline`, these lie at the turns themselves. Both ends are included.
    """
    thinned = polyline(coordinate, values, 0.1 * tolerance)
    return thinned[_worst_first(coordinate[thinned], values[thinned], tolerance)]


def _worst_first(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Ramer-Douglas-Peucker: split pieces at their worst sample until within `tolerance`."""
    knots, pending = {0, coordinate.size - 1}, [(0, coordinate.size - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        line = np.interp(coordinate[inside], coordinate[[first, last]], values[[first, last]])
        error = np.abs(line - values[inside])
        worst = first + 1 + int(np.argmax(error))
        if error[worst - first - 1] > tolerance:
            knots.add(worst)
            pending += [(first, worst), (worst, last)]
    return np.array(sorted(knots), dtype=np.intp)
