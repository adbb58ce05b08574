"""Exact response of first-order relaxation units to a piecewise polynomial input."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit

LANES = 8
SMALL_STEP = 0.5
SERIES = tuple((-1.0) ** j * 2.0 / math.factorial(j + 3) for j in range(15))
"""psi_2(z) / z = sum_j (-z)^j 2! / (j + 3)!, to 1e-18 at z = SMALL_STEP."""


@dataclass(frozen=True)
class Hold:
    """A piecewise polynomial input, cut at its knots and at the coordinates of interest.

    Steps whose lengths differ by no more than the rounding of the coordinate share
    one entry of `lengths`, so that an evenly sampled record needs few exponentials.

    Attributes
    ----------
    lengths : (C,) distinct step lengths.
    length_index : (S,) which length each step has.
    polynomials : (S, 3) p0, p1, p2 of the input on each step.
    output_index : (N,) number of steps to take before each output.
    input : (N,) the input at each output; at a jump, its value after the jump.
    """

    lengths: FloatArray
    length_index: NDArray[np.int64]
    polynomials: FloatArray
    output_index: NDArray[np.int64]
    input: FloatArray


def hold(
    knots: ArrayLike, values: ArrayLike, coordinate: ArrayLike, power: Literal[1, 2] = 1
) -> Hold:
    """Cut the input (channel)^power into steps; the channel is linear between its knots.

    The channel is zero before the first knot, so a non-zero first value is a jump there.
    After the last knot the channel keeps its last value. A repeated knot is a jump.

    Parameters
    ----------
    knots : (M,) ascending; equal neighbours mark a jump.
    values : (M,) the channel at the knots.
    coordinate : (N,) coordinates of the response, in any order.
    power : 2 for a load quadratic in the channel, as the Maxwell pressure is.

    Raises
    ------
    ValueError
        If knots and values do not match, are empty or not finite, or knots descend.
    """
    knots, values = np.asarray(knots, dtype=float), np.asarray(values, dtype=float)
    coordinate = np.atleast_1d(np.asarray(coordinate, dtype=float))
    _check(knots, values, coordinate)
    grid = np.unique(np.concatenate([knots, coordinate]))
    left, right = grid[:-1], grid[1:]
    interval = _interval(knots, 0.5 * left + 0.5 * right)
    start = _channel(knots, values, interval, left)
    rise = _channel(knots, values, interval, right) - start
    zero = np.zeros_like(start)
    terms = (start, rise, zero) if power == 1 else (start**2, 2.0 * start * rise, rise**2)
    lengths, length_index = _distinct(right - left, float(np.max(np.abs(grid))))
    at_outputs = _channel(knots, values, _interval(knots, coordinate), coordinate)
    return Hold(
        lengths,
        length_index,
        np.ascontiguousarray(np.stack(terms, axis=1)),
        np.searchsorted(grid, coordinate).astype(np.int64),
        at_outputs**power,
    )


def relaxation_response(
    load: Hold,
    instantaneous: FloatArray,
    compliances: FloatArray,
    time_constants: FloatArray,
) -> FloatArray:
    r"""Response D_0 w + sum_n D_n y_n of parallel relaxation units to an input w.

    tau_n y_n' = -y_n + w, y_n = 0 until the input starts. With D_n = 1/E_n this is
    the strain of the Voigt-Kelvin chain of Sarban et al. (2012), (1), under the
    pressure w.

    Parameters
    ----------
    instantaneous : D_0 (W,).
    compliances : D_n (W, K).
    time_constants : tau_n (W, K).

    Returns
    -------
    ndarray
        (W, N). A draw with a time constant that is not positive, or any value that
        is not finite, gives a row of NaN; no draw changes another's row.
    """
    size = instantaneous.size
    blocks = -(-size // LANES)
    response = np.empty((blocks * LANES, load.input.size))
    # All blocks have LANES draws, so the result of a draw does not depend on the other draws.
    _advance(
        load.lengths,
        load.length_index,
        load.polynomials,
        load.output_index,
        load.input,
        in_lanes(np.column_stack([instantaneous, compliances]), blocks),
        in_lanes(time_constants, blocks),
        response,
    )
    return response[:size]


def _check(knots: FloatArray, values: FloatArray, coordinate: FloatArray) -> None:
    if knots.ndim != 1 or knots.shape != values.shape or knots.size == 0:
        raise ValueError(f"knots {knots.shape} and values {values.shape} must be one equal (M,)")
    if not all(np.isfinite(array).all() for array in (knots, values, coordinate)):
        raise ValueError("knots, values and coordinate must be finite")
    if np.any(np.diff(knots) < 0.0):
        raise ValueError("knots must ascend")


def _interval(knots: FloatArray, coordinate: FloatArray) -> NDArray[np.int64]:
    """Index of the last knot not after each coordinate; -1 before the first knot."""
    return np.searchsorted(knots, coordinate, side="right").astype(np.int64) - 1


def _channel(
    knots: FloatArray, values: FloatArray, interval: NDArray[np.int64], coordinate: FloatArray
) -> FloatArray:
    """Channel at `coordinate` on the straight line of the given knot interval."""
    last = knots.size - 1
    lower, upper = np.clip(interval, 0, last), np.clip(interval + 1, 0, last)
    width = knots[upper] - knots[lower]
    share = (coordinate - knots[lower]) / np.where(width > 0.0, width, 1.0)
    share = np.where(width > 0.0, share, 0.0)
    line = (1.0 - share) * values[lower] + share * values[upper]
    return np.where(interval < 0, 0.0, line)


def _distinct(lengths: FloatArray, largest: float) -> tuple[FloatArray, NDArray[np.int64]]:
    if lengths.size == 0:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    order = np.argsort(lengths, kind="stable")
    ascending = lengths[order]
    resolution = 4.0 * np.finfo(float).eps * largest
    run = np.concatenate([[0], np.cumsum(np.diff(ascending) > resolution)])
    # Lengths of a jittered record form a long run without gaps: cut it into narrow groups.
    above = ascending - ascending[np.searchsorted(run, run)]
    new = (np.diff(run) > 0) | (np.diff(np.floor(above / resolution)) > 0.0)
    group = np.concatenate([[0], np.cumsum(new)])
    index = np.empty(lengths.size, dtype=np.int64)
    index[order] = group
    return np.bincount(group, ascending) / np.bincount(group), index


def in_lanes(values: FloatArray, blocks: int) -> FloatArray:
    """Reshape (W, K) to (blocks, K, LANES); pad the last block with ones."""
    size, units = values.shape
    padded = np.ones((blocks * LANES, units))
    padded[:size] = values
    return np.ascontiguousarray(padded.reshape(blocks, LANES, units).transpose(0, 2, 1))


@njit(cache=True)
def _weights(z: float) -> tuple[float, float, float, float]:
    """Return exp(-z), psi_0, psi_1 and psi_2 at z; NaN if z is negative."""
    if not z >= 0.0:
        return math.nan, math.nan, math.nan, math.nan
    if z < SMALL_STEP:
        total = 0.0
        for coefficient in SERIES[::-1]:
            total = total * z + coefficient
        psi_2 = z * total
        psi_1 = 0.5 * z * (1.0 - psi_2)
        psi_0 = z * (1.0 - psi_1)
        return 1.0 - psi_0, psi_0, psi_1, psi_2
    decay = math.exp(-z)
    psi_0 = 1.0 - decay
    psi_1 = 1.0 - psi_0 / z
    return decay, psi_0, psi_1, 1.0 - 2.0 * psi_1 / z


@njit(cache=True)
def _fill_weights(lengths, time_constants, weights) -> None:  # type: ignore[no-untyped-def]
    """Fill weights (C, K, 4, LANES) for every step length and one block (K, LANES)."""
    units, lanes = time_constants.shape
    for c in range(lengths.size):
        for n in range(units):
            for lane in range(lanes):
                tau = time_constants[n, lane]
                z = lengths[c] / tau if tau > 0.0 else math.nan
                decay, psi_0, psi_1, psi_2 = _weights(z)
                weights[c, n, 0, lane] = decay
                weights[c, n, 1, lane] = psi_0
                weights[c, n, 2, lane] = psi_1
                weights[c, n, 3, lane] = psi_2


@njit(cache=True)
def _advance(  # type: ignore[no-untyped-def]
    lengths, length_index, polynomials, output_index, load, compliances, time_constants, response
) -> None:
    """Fill response (blocks * LANES, N), one block of lanes after another.

    The first of the compliances (blocks, 1 + K, LANES) is the instantaneous compliance.
    """
    blocks, units, _ = time_constants.shape
    weights = np.empty((lengths.size, units, 4, LANES))
    sums = np.zeros((length_index.size + 1, LANES))
    state = np.empty((units, LANES))
    for block in range(blocks):
        _fill_weights(lengths, time_constants[block], weights)
        state[:] = 0.0
        for step in range(length_index.size):
            c = length_index[step]
            p_0, p_1, p_2 = polynomials[step, 0], polynomials[step, 1], polynomials[step, 2]
            sums[step + 1, :] = 0.0
            for n in range(units):
                for lane in range(LANES):
                    y = weights[c, n, 0, lane] * state[n, lane] + (
                        p_0 * weights[c, n, 1, lane]
                        + p_1 * weights[c, n, 2, lane]
                        + p_2 * weights[c, n, 3, lane]
                    )
                    state[n, lane] = y
                    sums[step + 1, lane] += compliances[block, n + 1, lane] * y
        for i in range(output_index.size):
            for lane in range(LANES):
                response[block * LANES + lane, i] = (
                    sums[output_index[i], lane] + compliances[block, 0, lane] * load[i]
                )
