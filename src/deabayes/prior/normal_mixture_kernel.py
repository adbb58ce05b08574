"""Quantiles of a mixture's conditional distributions, draw by draw."""

from __future__ import annotations

from math import erfc, exp, log, pi, sqrt

import numpy as np

from deabayes.compiled import njit
from deabayes.distributions.scores import FloatArray

MOST_ITERATIONS = 200
RESOLUTION = 1e-13
"""Relative; a step this small ends the search."""
LARGEST_SCORE = 37.0
"""Beyond it Phi is less than the smallest number."""

_compiled = njit(cache=True, error_model="numpy")


@_compiled
def _phi(score: float) -> float:
    return 0.5 * erfc(-score / sqrt(2.0))


@_compiled
def quantile(weights: FloatArray, centres: FloatArray, scales: FloatArray, score: float) -> float:
    """The x with sum_j w_j Phi((x - c_j) / s_j) = Phi(score), the weights summing to one.

    Newton's method on the logarithm of the smaller tail, inside a bracket that shrinks: the
    quantile of a mixture lies between the smallest and the largest of its components'.
    """
    side = -1.0 if score > 0.0 else 1.0
    score = min(max(score, -LARGEST_SCORE), LARGEST_SCORE)
    low, high = np.min(centres + scales * score), np.max(centres + scales * score)
    tail = _phi(side * score)
    x = 0.5 * (low + high)
    for _ in range(MOST_ITERATIONS):
        found, density = 0.0, 0.0
        for j in range(weights.size):
            e = (x - centres[j]) / scales[j]
            found += weights[j] * _phi(side * e)
            density += weights[j] * exp(-0.5 * e * e) / (scales[j] * sqrt(2.0 * pi))
        if (found < tail) == (side > 0.0):
            low = x
        else:
            high = x
        step = side * log(tail / found) * found / density if found * density > 0.0 else np.inf
        ahead = x + step
        if not low <= ahead <= high:
            ahead = 0.5 * (low + high)
        moved = abs(ahead - x)
        x = ahead
        if moved <= RESOLUTION * (1.0 + abs(x)):
            break
    return x


@_compiled
def colour(
    z: FloatArray, log_weights: FloatArray, means: FloatArray, factors: FloatArray
) -> FloatArray:
    """x (W, k) of scores z (W, k): see `NormalMixture`.

    Parameters
    ----------
    log_weights : (K,); means : (K, k); factors : (K, k, k).
    """
    size, dimension = z.shape
    count = log_weights.size
    x = np.empty_like(z)
    e = np.empty((count, dimension))
    for draw in range(size):
        gathered = log_weights.copy()
        for i in range(dimension):
            centres = means[:, i].copy()
            for j in range(count):
                for before in range(i):
                    centres[j] += factors[j, i, before] * e[j, before]
            scales = factors[:, i, i]
            weights = np.exp(gathered - np.max(gathered))
            x[draw, i] = quantile(weights / np.sum(weights), centres, scales, z[draw, i])
            for j in range(count):
                e[j, i] = (x[draw, i] - centres[j]) / scales[j]
                gathered[j] -= 0.5 * e[j, i] ** 2 + log(scales[j])
    return x
