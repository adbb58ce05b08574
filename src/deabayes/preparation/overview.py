"""A raw record thinned for drawing, with its extremes kept."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.preparation.working import BoolArray, IntArray

LIMIT = 2000


def thinned(
    coordinate: FloatArray,
    response: FloatArray,
    excitation: FloatArray,
    masked: BoolArray,
    limit: int = LIMIT,
) -> IntArray:
    """Indices of at most `limit` samples that draw like the whole record (M,).

    Of each bin the smallest and the largest response stay, masked and visible
    samples apart. Bins share out equally the duration and the path of the
    excitation, so that a two-second ramp before half an hour of hold is seen.
    """
    size = coordinate.size
    if size <= limit:
        return np.arange(size)
    run = np.concatenate([[0], np.cumsum(np.diff(masked.astype(int)) != 0)])
    bins = max((limit - 2 * (int(run[-1]) + 1)) // 2, 1)
    weight = _share(np.abs(np.diff(coordinate))) + _share(np.abs(np.diff(excitation)))
    position = np.concatenate([[0.0], weight]) / weight[-1]
    label = np.minimum((position * bins).astype(int), bins - 1)
    group = np.concatenate([[0], np.cumsum((np.diff(label) != 0) | (np.diff(run) != 0))])
    order = np.lexsort((response, group))
    starts = np.flatnonzero(np.concatenate([[True], np.diff(group) != 0]))
    ends = np.concatenate([starts[1:], [size]]) - 1
    return np.unique(np.concatenate([order[starts], order[ends]]))[:limit]


def _share(steps: FloatArray) -> FloatArray:
    """Cumulative share of a path; zero where there is none."""
    total = float(steps.sum())
    return np.cumsum(steps) / total if total > 0.0 else np.zeros(steps.size)
