"""Kalman filters and exact simulation of correlated noise, also for many draws in parallel."""

from __future__ import annotations

import math

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit

_compiled = njit(cache=True, error_model="numpy")


@_compiled
def distances(coordinate: FloatArray) -> FloatArray:
    """Distance of each point from the previous point, (N,); 0 for the first point.

    A step that equals the last different step up to rounding is set to that step. A kernel then
    need not compute the decay again.
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
    """Innovations and variances (W, N) for sigma^2 exp(-|d|/tau) + sigma_white^2 w."""
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
    """Exact samples (W, N) with covariance sigma^2 exp(-|d|/tau) from normals (W, N, 1)."""
    sample = np.empty(normal.shape[:2])
    for draw in range(normal.shape[0]):
        sigma = math.sqrt(correlated[draw])
        state = normal[draw, 0, 0]
        sample[draw, 0] = sigma * state
        for k in range(1, normal.shape[1]):
            expm1 = math.expm1(-distance[k] * rates[draw])
            state = (1.0 + expm1) * state + math.sqrt(-expm1 * (2.0 + expm1)) * normal[draw, k, 0]
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
    """Innovations and variances for sigma^2 (1 + x) exp(-x) + sigma_white^2 w, x = rate |d|."""
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


LANES = 32
TILE = 32
PRODUCT = 8
LOG2_E = 1.0 / math.log(2.0)
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
LOG_2PI = math.log(2.0 * math.pi)
C2, C3, C4, C5, C6, C7, C8, C9, C10, C11, C12, C13 = (1.0 / math.factorial(n) for n in range(2, 14))

_compiled_lanes = njit(cache=True, error_model="numpy", fastmath={"contract"})
_inlined = njit(inline="always", error_model="numpy", fastmath={"contract"})


@_inlined
def _decay(distance, rates, correlated, powers, factors, decay, driven) -> None:  # type: ignore[no-untyped-def]
    """phi = exp(-d/tau) and q = sigma^2 (1 - phi^2) per lane, through expm1.

    With x = -d/tau = k ln 2 + y: expm1(x) = 2^k expm1(y) + 2^k - 1, where 2^k is
    written by its exponent bits and expm1(y) is its Taylor series of degree 13.
    """
    for lane in range(LANES):
        x = max(-distance * rates[lane], -700.0)
        k = np.floor(x * LOG2_E + 0.5)
        y = (x - k * LN2_HIGH) - k * LN2_LOW
        tail = C8 + y * (C9 + y * (C10 + y * (C11 + y * (C12 + y * C13))))
        head = C2 + y * (C3 + y * (C4 + y * (C5 + y * (C6 + y * (C7 + y * tail)))))
        powers[lane] = (np.int64(k) + 1023) << 52
        decay[lane] = y + y * y * head
    for lane in range(LANES):
        expm1 = factors[lane] * decay[lane] + (factors[lane] - 1.0)
        decay[lane] = 1.0 + expm1
        driven[lane] = -expm1 * (2.0 + expm1) * correlated[lane]


@_inlined
def _advance(tile, k, weight, decay, driven, white, state, spread, squares, product) -> None:  # type: ignore[no-untyped-def]
    """One predict-and-update of the scalar Kalman filter in every lane."""
    for lane in range(LANES):
        mean = decay[lane] * state[lane]
        predicted = decay[lane] * decay[lane] * spread[lane] + driven[lane]
        measured = white[lane] * weight
        innovation_variance = predicted + measured
        innovation = tile[k, lane] - mean
        precision = 1.0 / innovation_variance
        gain = predicted * precision
        state[lane] = mean + gain * innovation
        spread[lane] = gain * measured
        squares[lane] += innovation * innovation * precision
        product[lane] *= innovation_variance


@_inlined
def _collect(product, logs) -> None:  # type: ignore[no-untyped-def]
    for lane in range(LANES):
        logs[lane] += math.log(product[lane])
        product[lane] = 1.0


@_inlined
def _start(first, white, correlated, rates, lane_white, lane_correlated, lane_rates, total) -> None:  # type: ignore[no-untyped-def]
    """Load the parameters of a group of draws; lanes past the last draw repeat the last draw."""
    for lane in range(LANES):
        draw = min(first + lane, white.size - 1)
        total[lane] = white[draw] + correlated[draw]
        lane_white[lane] = white[draw] / total[lane]
        lane_correlated[lane] = correlated[draw] / total[lane]
        lane_rates[lane] = rates[draw]


@_compiled_lanes
def log_prob(
    residuals: FloatArray,
    distance: FloatArray,
    weights: FloatArray,
    white: FloatArray,
    correlated: FloatArray,
    rates: FloatArray,
) -> FloatArray:
    """log N(r; 0, sigma^2 exp(-|t_j - t_k|/tau) + sigma_white^2 diag(w)), (W,).

    Parameters
    ----------
    residuals : (W, N), C-contiguous.
    distance : (N,) distance from the previous point; 0 for the first point.
    weights : (N,).
    white, correlated, rates : (W,) variances and 1/tau.
    """
    draws, points = residuals.shape
    result = np.empty(draws)
    lane_white, lane_correlated, lane_rates = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    total, state, spread = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    squares, product, logs = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    decay, driven = np.empty(LANES), np.empty(LANES)
    powers = np.empty(LANES, np.int64)
    factors = powers.view(np.float64)
    tile = np.empty((TILE, LANES))
    for first in range(0, draws, LANES):
        _start(first, white, correlated, rates, lane_white, lane_correlated, lane_rates, total)
        state[:], squares[:], logs[:], product[:] = 0.0, 0.0, 0.0, 1.0
        spread[:] = lane_correlated
        last = -1.0
        for start in range(0, points, TILE):
            length = min(TILE, points - start)
            for lane in range(LANES):
                draw = min(first + lane, draws - 1)
                for k in range(length):
                    tile[k, lane] = residuals[draw, start + k]
            for k in range(length):
                if distance[start + k] != last:
                    last = distance[start + k]
                    _decay(last, lane_rates, lane_correlated, powers, factors, decay, driven)
                _advance(
                    tile, k, weights[start + k], decay, driven, lane_white,
                    state, spread, squares, product,
                )  # fmt: skip
                if k % PRODUCT == PRODUCT - 1:
                    _collect(product, logs)
            _collect(product, logs)
        for lane in range(min(LANES, draws - first)):
            scale = total[lane]
            result[first + lane] = -0.5 * (
                squares[lane] / scale + logs[lane] + points * (math.log(scale) + LOG_2PI)
            )
    return result
