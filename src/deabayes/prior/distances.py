"""How far draws are from a distribution: the largest distance of distribution functions."""

from __future__ import annotations

import numpy as np

from deabayes.distributions.scores import FloatArray


def distance_from_normal(z: FloatArray) -> float:
    """How far draws z (S, k) are from N(0, I): the largest distance of distribution functions.

    Of each column from N(0, 1), and of the squared length from chi-squared with k degrees of
    freedom, which sees a bent or forked shape that no column shows.
    """
    from scipy.special import gammainc, ndtr

    columns = _with_squared_length(z)
    columns[:, :-1] = ndtr(columns[:, :-1])
    columns[:, -1] = gammainc(z.shape[1] / 2, columns[:, -1] / 2)
    return _largest_gap(np.sort(columns, axis=0))


def distance(z: FloatArray, others: FloatArray, weights: FloatArray) -> float:
    """How far draws z (S, k) are from weighted others (S_o, k): as `distance_from_normal`."""
    gaps = []
    for own, other in zip(_with_squared_length(z).T, _with_squared_length(others).T, strict=True):
        order = np.argsort(other)
        below = np.concatenate([[0.0], np.cumsum(weights[order])]) / weights.sum()
        at = np.searchsorted(other[order], np.sort(own), side="right")
        gaps.append(_largest_gap(below[at][:, None]))
    return max(gaps)


def _with_squared_length(z: FloatArray) -> FloatArray:
    return np.concatenate([z, np.sum(z**2, axis=1, keepdims=True)], axis=1)


def _largest_gap(probabilities: FloatArray) -> float:
    """Between (S, n) distribution functions at S ascending draws and the share of these below."""
    size = len(probabilities)
    above = np.arange(1, size + 1)[:, None] / size - probabilities
    return float(np.max(np.maximum(above, 1.0 / size - above)))
