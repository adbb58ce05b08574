"""Log-likelihood of exponentially correlated plus white noise, many draws in lockstep.

LANES draws share each time step, so that the compiler turns every inner loop
into vector instructions; a lane never reads another's values. Variances are
taken relative to a draw's total, and log S_k is summed as the log of products
of eight, whose smallest factor would have to be below 1e-38 to underflow.
"""

from __future__ import annotations

import math

import numpy as np

from deabayes.compiled import njit
from deabayes.experiment import FloatArray

LANES = 32
TILE = 32
PRODUCT = 8
LOG2_E = 1.0 / math.log(2.0)
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
LOG_2PI = math.log(2.0 * math.pi)
C2, C3, C4, C5, C6, C7, C8, C9, C10, C11, C12, C13 = (1.0 / math.factorial(n) for n in range(2, 14))

_compiled = njit(cache=True, error_model="numpy", fastmath={"contract"})
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
    """Load the parameters of a group; past the last draw, lanes repeat it."""
    for lane in range(LANES):
        draw = min(first + lane, white.size - 1)
        total[lane] = white[draw] + correlated[draw]
        lane_white[lane] = white[draw] / total[lane]
        lane_correlated[lane] = correlated[draw] / total[lane]
        lane_rates[lane] = rates[draw]


@_compiled
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
    distance : (N,) from the point before, 0 first.
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
