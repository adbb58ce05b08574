"""Kalman filters and exact simulation of correlated noise, one draw after another.

Kernels return the innovations v_k = r_k - E[r_k | r_1..k-1] and their variances
S_k. `distance` (N,) is that from the point before, 0 first; the first point is
drawn from the stationary law.
"""

from __future__ import annotations

import math

import numpy as np

from deabayes.compiled import njit
from deabayes.experiment import FloatArray

_compiled = njit(cache=True, error_model="numpy")


@_compiled
def distances(coordinate: FloatArray) -> FloatArray:
    """Distance from the point before, (N,), 0 for the first.

    A step that agrees with one before it within the rounding of the distance from the first
    point is made equal to it, so that a kernel need not compute its decay anew.
    """
    steps = np.zeros(coordinate.size)
    extent = np.max(np.abs(coordinate - coordinate[0]))
    resolution = 4.0 * np.finfo(np.float64).eps * extent
    reference = 0.0
    for k in range(1, coordinate.size):
        step = abs(coordinate[k] - coordinate[k - 1])
        if abs(step - reference) > resolution:
            reference = step
        steps[k] = reference
    return steps


@_compiled
def filter_exponential(
    residuals: FloatArray,
    distance: FloatArray,
    weights: FloatArray,
    white: FloatArray,
    correlated: FloatArray,
    rates: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Covariance sigma^2 exp(-|d|/tau) + sigma_white^2 w: a scalar state, (W, N) each."""
    innovation, variance = np.empty_like(residuals), np.empty_like(residuals)
    for draw in range(residuals.shape[0]):
        state, spread = 0.0, correlated[draw]
        for k in range(residuals.shape[1]):
            expm1 = math.expm1(-distance[k] * rates[draw])
            decay = 1.0 + expm1
            predicted = decay * decay * spread - expm1 * (2.0 + expm1) * correlated[draw]
            measured = white[draw] * weights[k]
            variance[draw, k] = predicted + measured
            innovation[draw, k] = residuals[draw, k] - decay * state
            gain = predicted / variance[draw, k]
            state = decay * state + gain * innovation[draw, k]
            spread = gain * measured
    return innovation, variance


@_compiled
def simulate_exponential(
    normal: FloatArray, distance: FloatArray, correlated: FloatArray, rates: FloatArray
) -> FloatArray:
    """Exact samples (W, N) with covariance sigma^2 exp(-|d|/tau) from normals (W, N)."""
    sample = np.empty_like(normal)
    for draw in range(normal.shape[0]):
        sigma = math.sqrt(correlated[draw])
        state = normal[draw, 0]
        sample[draw, 0] = sigma * state
        for k in range(1, normal.shape[1]):
            expm1 = math.expm1(-distance[k] * rates[draw])
            state = (1.0 + expm1) * state + math.sqrt(-expm1 * (2.0 + expm1)) * normal[draw, k]
            sample[draw, k] = sigma * state
    return sample


@_compiled
def matern32_transition(x: float) -> tuple[float, float, float, float, float, float, float]:
    """Transition and driving covariance of (f, f'/lambda) over x = lambda d, unit variance.

    Phi = exp(-x) [[1 + x, x], [-x, 1 - x]], Q = I - Phi Phi^T. The first entry of
    Q is O(x^3), so it is summed as exp(-2x) sum_{n>=3} (2x)^n / n! for small x.
    """
    decay = math.exp(-x)
    y = 2.0 * x
    if y < 0.5:
        term = y * y * y / 6.0
        tail = term
        for n in range(4, 16):
            term *= y / n
            tail += term
    else:
        tail = math.expm1(y) - y - 0.5 * y * y if y < 700.0 else math.inf
    squared = decay * decay
    q11 = squared * tail if y < 700.0 else 1.0
    q22 = squared * (math.expm1(y) + y - 0.5 * y * y) if y < 700.0 else 1.0
    q12 = y * x * squared
    return decay * (1.0 + x), decay * x, -decay * x, decay * (1.0 - x), q11, q12, q22


@_compiled
def filter_matern32(
    residuals: FloatArray,
    distance: FloatArray,
    weights: FloatArray,
    white: FloatArray,
    correlated: FloatArray,
    rates: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Covariance sigma^2 (1 + x) exp(-x), x = rate |d|, plus sigma_white^2 w: two states."""
    innovation, variance = np.empty_like(residuals), np.empty_like(residuals)
    for draw in range(residuals.shape[0]):
        scale = correlated[draw]
        m1, m2, p11, p12, p22 = 0.0, 0.0, scale, 0.0, scale
        for k in range(residuals.shape[1]):
            a, b, c, d, q11, q12, q22 = matern32_transition(rates[draw] * distance[k])
            m1, m2 = a * m1 + b * m2, c * m1 + d * m2
            p11, p12, p22 = (
                a * a * p11 + 2.0 * a * b * p12 + b * b * p22 + scale * q11,
                a * c * p11 + (a * d + b * c) * p12 + b * d * p22 + scale * q12,
                c * c * p11 + 2.0 * c * d * p12 + d * d * p22 + scale * q22,
            )
            measured = white[draw] * weights[k]
            variance[draw, k] = p11 + measured
            innovation[draw, k] = residuals[draw, k] - m1
            gain1, gain2 = p11 / variance[draw, k], p12 / variance[draw, k]
            m1 += gain1 * innovation[draw, k]
            m2 += gain2 * innovation[draw, k]
            p22 -= gain2 * p12
            p11, p12 = gain1 * measured, p12 * measured / variance[draw, k]
    return innovation, variance


@_compiled
def simulate_matern32(
    normal: FloatArray, distance: FloatArray, correlated: FloatArray, rates: FloatArray
) -> FloatArray:
    """Exact samples (W, N) with covariance sigma^2 (1 + x) exp(-x) from normals (W, N, 2)."""
    sample = np.empty(normal.shape[:2])
    for draw in range(normal.shape[0]):
        sigma = math.sqrt(correlated[draw])
        f, g = normal[draw, 0, 0], normal[draw, 0, 1]
        sample[draw, 0] = sigma * f
        for k in range(1, normal.shape[1]):
            a, b, c, d, q11, q12, q22 = matern32_transition(rates[draw] * distance[k])
            l11 = math.sqrt(q11)
            l21 = q12 / l11 if l11 > 0.0 else 0.0
            l22 = math.sqrt(max(q22 - l21 * l21, 0.0))
            f, g = (
                a * f + b * g + l11 * normal[draw, k, 0],
                c * f + d * g + l21 * normal[draw, k, 0] + l22 * normal[draw, k, 1],
            )
            sample[draw, k] = sigma * f
    return sample
