"""A sampled curve as few straight pieces, with a bound on the error."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.records.preparation.working import IntArray


def polyline(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Indices of samples between which straight lines stay within `tolerance` of all samples.

    From each knot the slopes that pass every following sample within the
    tolerance form a narrowing cone; the next knot is the last sample that lies
    within the cone of all before it (the cone intersection method of Sklansky
    and Gonzalez 1980, with errors measured along `values`, which is the error
    an excitation makes). One pass, whatever the record looks like.

    Parameters
    ----------
    coordinate, values : (M,), the coordinate never descending; where it repeats, the curve jumps.
    tolerance : largest allowed |line - sample|, in the unit of `values`.

    Returns
    -------
    (K,) ascending indices, the first and the last sample always among them.
    """
    x, y = coordinate.tolist(), values.tolist()
    knots = [0]
    while knots[-1] < len(x) - 1:
        knots.append(_furthest(x, y, knots[-1], tolerance))
    return np.array(knots, dtype=np.intp)


def _furthest(x: list[float], y: list[float], start: int, tolerance: float) -> int:
    """The last sample a line from sample `start` reaches with all before it in tolerance."""
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
    """Where an excitation turns: ends of ramps, steps, peaks of triangles.

    The inner ones of its `turns`; the two of a jump within a sampling `interval` are one corner,
    at the later.
    """
    knots = turns(coordinate, values, tolerance)
    inner = coordinate[knots[1:-1]]
    before_jump = np.diff(coordinate[knots[1:]]) <= 1.5 * interval
    return inner[~before_jump]


def turns(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Indices of a Ramer-Douglas-Peucker polyline (Douglas and Peucker 1973) within `tolerance`.

    Unlike the knots of `polyline` these stand at the turns themselves; ends are among them.
    """
    thinned = polyline(coordinate, values, 0.1 * tolerance)
    return thinned[_worst_first(coordinate[thinned], values[thinned], tolerance)]


def _worst_first(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Ramer-Douglas-Peucker: split each piece at its worst sample until within `tolerance`."""
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
