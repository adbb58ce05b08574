"""A raw record thinned for drawing, with its extremes kept."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.preparation.polyline import polyline
from deabayes.preparation.working import BoolArray, IntArray

LIMIT = 2000
NOISE_FRACTION = 0.01


def thinned(
    coordinate: FloatArray,
    response: FloatArray,
    excitation: FloatArray,
    masked: BoolArray,
    limit: int = LIMIT,
) -> IntArray:
    """Indices of at most `limit` samples that draw like the whole record (M,).

    Of each bin the smallest and the largest response stay, masked and visible
    samples apart. Bins share out equally the duration and the paths of the
    excitation and of the response, so that a two-second ramp before half an
    hour of hold is seen.
    """
    size = coordinate.size
    if size <= limit:
        return np.arange(size)
    run = np.concatenate([[0], np.cumsum(np.diff(masked.astype(int)) != 0)])
    bins = max((limit - 2 * (int(run[-1]) + 1)) // 2, 1)
    position = coordinate / float(np.ptp(coordinate) or 1.0)
    position = position + path(coordinate, excitation) + path(coordinate, response)
    position = (position - position[0]) / (position[-1] - position[0])
    label = np.minimum((position * bins).astype(int), bins - 1)
    group = np.concatenate([[0], np.cumsum((np.diff(label) != 0) | (np.diff(run) != 0))])
    order = np.lexsort((response, group))
    starts = np.flatnonzero(np.concatenate([[True], np.diff(group) != 0]))
    ends = np.concatenate([starts[1:], [size]]) - 1
    return np.unique(np.concatenate([order[starts], order[ends]]))[:limit]


def path(coordinate: FloatArray, values: FloatArray) -> FloatArray:
    """Share of its path that a channel has gone up to each sample (M,), noise left out.

    Zero for a constant channel and for a coordinate that stands still somewhere.
    """
    size = float(np.ptp(values))
    if size == 0.0 or np.any(np.diff(coordinate) <= 0.0):
        return np.zeros(coordinate.size)
    knots = polyline(coordinate, values, NOISE_FRACTION * size)
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values[knots])))])
    return np.interp(coordinate, coordinate[knots], gone / gone[-1])
