"""The polynomials of a warp, evaluated and solved walker by walker."""

from __future__ import annotations

from math import exp

import numpy as np

from deabayes.compiled import njit
from deabayes.experiment import FloatArray

SHIFT_LIMIT, SCALE_LIMIT = 6.0, 3.0
"""Standard deviations beyond which terms stay constant: polynomials must not run away."""
KNOTS = (-2.2, -1.2, -0.4, 0.4, 1.2, 2.2)
"""Where a coordinate's spline bends: squares of what lies beyond a knot, outwards."""
RATES = (-0.4, 0.4)
"""Of exponentials of a coordinate. z is mostly the logarithm of a parameter, and a ridge the
balance of a sum of parameters: they go on where a spline fitted to what was visited ends."""


@njit(cache=True, error_model="numpy", inline="always")
def _lead(
    y: FloatArray,
    k: int,
    shifts: FloatArray,
    scales: FloatArray,
    shift: FloatArray,
    log_scale: FloatArray,
) -> None:
    """Add the terms led by coordinate k of y (d,) to the polynomials of the later ones."""
    dimension = y.size
    bounded = min(max(y[k], -SHIFT_LIMIT), SHIFT_LIMIT)
    for j in range(k + 1):
        term = min(max(y[j], -SHIFT_LIMIT), SHIFT_LIMIT) * bounded
        for later in range(k + 1, dimension):
            shift[later] += term * shifts[k, j, later]
    cube = bounded**3
    for index, knot in enumerate(KNOTS):
        beyond = bounded - knot if knot > 0 else knot - bounded
        if beyond > 0:
            for later in range(k + 1, dimension):
                shift[later] += beyond**2 * shifts[k, dimension + 2 + index, later]
    for index, rate in enumerate(RATES):
        term = exp(rate * bounded)
        for later in range(k + 1, dimension):
            shift[later] += term * shifts[k, dimension + 2 + len(KNOTS) + index, later]
    near = min(max(y[k], -SCALE_LIMIT), SCALE_LIMIT)
    for later in range(k + 1, dimension):
        shift[later] += bounded * shifts[k, dimension, later]
        shift[later] += cube * shifts[k, dimension + 1, later]
        log_scale[later] += near * (scales[k, 0, later] + near * scales[k, 1, later])


@njit(cache=True, error_model="numpy")
def polynomials(
    y: FloatArray, shifts: FloatArray, scales: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """P_k(y_1 .. y_k-1) and S_k(y_1 .. y_k-1) at y (W, d), without their constants."""
    shift, log_scale = np.zeros(y.shape), np.zeros(y.shape)
    for walker in range(y.shape[0]):
        for k in range(y.shape[1] - 1):
            _lead(y[walker], k, shifts, scales, shift[walker], log_scale[walker])
    return shift, log_scale


@njit(cache=True, error_model="numpy")
def solve(x: FloatArray, shifts: FloatArray, scales: FloatArray, offsets: FloatArray) -> FloatArray:
    """y (W, d) with y_k = P_k(y_1 .. y_k-1) + x_k exp(S_k(y_1 .. y_k-1)), one k after another.

    `offsets` (2, d) are the constants of P and S.
    """
    y = np.empty(x.shape)
    shift, log_scale = np.empty(x.shape[1]), np.empty(x.shape[1])
    for walker in range(x.shape[0]):
        shift[:] = offsets[0]
        log_scale[:] = offsets[1]
        for k in range(x.shape[1]):
            y[walker, k] = shift[k] + x[walker, k] * exp(log_scale[k])
            _lead(y[walker], k, shifts, scales, shift, log_scale)
    return y
