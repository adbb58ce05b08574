"""Normal mixtures widened by the spread between specimens, for many populations at once."""

from __future__ import annotations

from math import exp, inf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from deabayes.compiled import njit
from deabayes.experiment import FloatArray


@njit(cache=True, error_model="numpy")
def log_marginals(
    centres: FloatArray,
    spreads: FloatArray,
    log_weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    member: NDArray[np.intp],
    members: int,
) -> FloatArray:
    """log sum_j v_j N(m; a_j, B_j + diag(s^2)) of every member, (W, members), up to a constant.

    Parameters
    ----------
    centres, spreads : (W, d) m and s.
    log_weights, means, covariances : (J,), (J, d), (J, d, d) of the components of all members.
    member : (J,) whose component it is.
    """
    walkers, dimension = centres.shape
    result = np.full((walkers, members), -inf)
    factor = np.empty((dimension, dimension))
    solved = np.empty(dimension)
    for w in range(walkers):
        for j in range(log_weights.size):
            total = log_weights[j]
            for row in range(dimension):
                residual = centres[w, row] - means[j, row]
                for column in range(row + 1):
                    value = covariances[j, row, column]
                    if row == column:
                        value += spreads[w, row] ** 2
                    for k in range(column):
                        value -= factor[row, k] * factor[column, k]
                    if row == column:
                        factor[row, row] = sqrt(value)
                    else:
                        factor[row, column] = value / factor[column, column]
                        residual -= factor[row, column] * solved[column]
                solved[row] = residual / factor[row, row]
                total -= 0.5 * solved[row] ** 2 + log(factor[row, row])
            before = result[w, member[j]]
            high, low = max(before, total), min(before, total)
            result[w, member[j]] = high if low == -inf else high + log(1.0 + exp(low - high))
    return result
