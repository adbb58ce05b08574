"""The polynomials of a warp, evaluated and solved walker by walker."""

from __future__ import annotations

import numpy as np
from numba import njit

from deabayes.experiment import FloatArray

LIMIT = 4.0
"""Standard deviations beyond which products stay constant: polynomials must not run away."""


@njit(cache=True, error_model="numpy", inline="always")
def _lead(y: FloatArray, k: int, coefficients: FloatArray, result: FloatArray) -> None:
    """Add the terms led by coordinate k of y (d,) to the polynomials of the later ones."""
    dimension = y.size
    bounded = min(max(y[k], -LIMIT), LIMIT)
    for j in range(k + 1):
        term = min(max(y[j], -LIMIT), LIMIT) * bounded
        for later in range(k + 1, dimension):
            result[later] += term * coefficients[k, j, later]
    cube = bounded**3
    for later in range(k + 1, dimension):
        result[later] += y[k] * coefficients[k, -2, later] + cube * coefficients[k, -1, later]


@njit(cache=True, error_model="numpy")
def polynomials(y: FloatArray, coefficients: FloatArray) -> FloatArray:
    """P_k(y_1 .. y_k-1) at y (W, d)."""
    result = np.zeros(y.shape)
    for walker in range(y.shape[0]):
        for k in range(y.shape[1] - 1):
            _lead(y[walker], k, coefficients, result[walker])
    return result


@njit(cache=True, error_model="numpy")
def solve(rest: FloatArray, coefficients: FloatArray) -> FloatArray:
    """y (W, d) with y_k - P_k(y_1 .. y_k-1) = rest_k, one coordinate after another."""
    y = rest.copy()
    for walker in range(y.shape[0]):
        for k in range(y.shape[1] - 1):
            _lead(y[walker], k, coefficients, y[walker])
    return y
