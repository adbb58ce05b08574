r"""Linear systems driven by the square of a voltage that charges through a resistance.

The voltage v follows V by v' = kappa (g V - v), where V is linear between its knots. The input of
z' = A z + B w is w = v^2. On a step of length h (u = s / h) with V = p0 + p1 u,

v = a_0 + a_1 u + r exp(-kappa s),   a_0 = g (p0 - p1 / (kappa h)),   a_1 = g p1,   r = v(0) - a_0,
w = a_0^2 + 2 a_0 a_1 u + a_1^2 u^2 + 2 r (a_0 + a_1 u) exp(-kappa s) + r^2 exp(-2 kappa s).

`state_space` solves for the polynomial. The rest of w is the sum e_1 + e_3 of the states

e_1' = -kappa e_1 + e_2,   e_2' = -kappa e_2,   e_3' = -2 kappa e_3,

which are added to the system and set at the start of every step. The solution therefore has no
discretisation error.
"""

from __future__ import annotations

import math

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.linear import LANES, Hold, in_lanes
from deabayes.integrate.state_space import StateSpace, fill_lanes, output_lanes, step_lanes

EXTRA = 3
EPSILON = float(np.finfo(float).eps)


def charged_response(
    space: StateSpace, gain: FloatArray, decay: FloatArray, voltage: Hold
) -> FloatArray:
    """Output (W, N) for the input v^2; the system is at rest and uncharged at the first knot.

    Parameters
    ----------
    gain : g (W,).
    decay : kappa (W,) [1/s].
    voltage : V, held with power 1.

    Returns
    -------
    ndarray
        (W, N). A draw with a value that is not finite, or a decay that is not positive,
        gives a row of NaN; no draw changes another's row.
    """
    walkers, states = space.b.shape
    blocks = -(-walkers // LANES)
    decay = np.where(decay > 0.0, decay, np.nan)
    a = np.zeros((walkers, states + EXTRA, states + EXTRA))
    a[:, :states, :states] = space.a
    a[:, :states, states] = a[:, :states, states + 2] = space.b
    a[:, states, states] = a[:, states + 1, states + 1] = -decay
    a[:, states, states + 1] = 1.0
    a[:, states + 2, states + 2] = -2.0 * decay
    none = np.zeros((walkers, EXTRA))
    b, c = np.hstack([space.b, none]), np.hstack([space.c, none])
    response = np.empty((blocks * LANES, voltage.input.size))
    _advance_charged(
        voltage.lengths,
        voltage.length_index,
        voltage.polynomials,
        voltage.output_index,
        in_lanes(a.reshape(walkers, -1), blocks),
        in_lanes(np.column_stack([b, c, space.d, gain, decay]), blocks),
        response,
    )
    return response[:walkers]


def charged_voltage(
    knots: FloatArray, voltage: FloatArray, gain: FloatArray, decay: FloatArray, times: FloatArray
) -> FloatArray:
    r"""Voltage v (W, N) at separate times for every draw; v is zero before the first knot.

    v' = kappa (g V - v) is (4) of Sarban et al. (2012). At s after a knot, with V = p0 + m s,

    v = v(0) exp(-kappa s) + g (p0 psi_0 + m (s - psi_0 / kappa)),   psi_0 = 1 - exp(-kappa s).

    Parameters
    ----------
    knots, voltage : (M,) knots of V, which is linear between them; a repeated knot is a jump.
    gain, decay : g and kappa [1/s] (W,); a decay that is not positive gives a row of NaN.
    times : (W, N), in any order.
    """
    response = np.empty(times.shape)
    decay = np.where(decay > 0.0, decay, np.nan)
    _advance_voltage(knots, voltage, gain, decay, times, response)
    return response


@njit(cache=True)
def _advance_voltage(knots, voltage, gain, decay, times, response) -> None:  # type: ignore[no-untyped-def]
    """Fill response (W, N) with v."""
    last = knots.size - 1
    # As in `linear.hold`, steps that differ only by rounding share one exponential.
    resolution = 4.0 * EPSILON * max(abs(knots[0]), abs(knots[last]))
    slopes, charged = np.zeros(knots.size), np.zeros(knots.size)
    for k in range(last):
        if knots[k + 1] > knots[k]:
            slopes[k] = (voltage[k + 1] - voltage[k]) / (knots[k + 1] - knots[k])
    for w in range(times.shape[0]):
        g, kappa, s, grown = gain[w], decay[w], 0.0, 0.0
        for k in range(last):
            step = knots[k + 1] - knots[k]
            if not abs(step - s) <= resolution:
                s, grown = step, -math.expm1(-kappa * step)
            rise = voltage[k] * grown + slopes[k] * (s - grown / kappa)
            charged[k + 1] = charged[k] * (1.0 - grown) + g * rise
        k = 0
        for i in range(times.shape[1]):
            while k < last and knots[k + 1] <= times[w, i]:
                k += 1
            while k > 0 and knots[k] > times[w, i]:
                k -= 1
            step = max(times[w, i] - knots[k], 0.0)
            if not abs(step - s) <= resolution:
                s, grown = step, -math.expm1(-kappa * step)
            rise = voltage[k] * grown + slopes[k] * (s - grown / kappa)
            response[w, i] = charged[k] * (1.0 - grown) + g * rise


@njit(cache=True)
def _advance_charged(  # type: ignore[no-untyped-def]
    lengths, length_index, voltages, output_index, matrices, vectors, response
) -> None:
    """Fill response (blocks * LANES, N), one block of lanes after another.

    matrices (blocks, n n, LANES) hold A, vectors (blocks, 2 n + 3, LANES) B, C, D, g, kappa.
    """
    states = (vectors.shape[1] - 3) // 2
    steps = np.empty((lengths.size, states, states, LANES))
    drives = np.empty((lengths.size, states, 3, LANES))
    outputs = np.empty((length_index.size + 1, LANES))
    squares = np.zeros((length_index.size + 1, LANES))
    state, after = np.empty((states, LANES)), np.empty((states, LANES))
    polynomial, charged = np.empty((3, LANES)), np.empty(LANES)
    for block in range(vectors.shape[0]):
        weights, direct = vectors[block, states : 2 * states], vectors[block, 2 * states]
        gain, decay = vectors[block, 2 * states + 1], vectors[block, 2 * states + 2]
        fill_lanes(lengths, matrices[block], vectors[block], steps, drives)
        state[:] = 0.0
        charged[:] = 0.0
        output_lanes(weights, state, outputs[0])
        for s in range(length_index.size):
            c = length_index[s]
            _charge(voltages[s], lengths[c], gain, decay, charged, polynomial, state[-3:])
            step_lanes(steps[c], drives[c], polynomial, state, after)
            state, after = after, state
            output_lanes(weights, state, outputs[s + 1])
            squares[s + 1] = charged * charged
        for i in range(output_index.size):
            for lane in range(LANES):
                response[block * LANES + lane, i] = (
                    outputs[output_index[i], lane] + direct[lane] * squares[output_index[i], lane]
                )


@njit(cache=True)
def _charge(voltage, length, gain, decay, charged, polynomial, extra) -> None:  # type: ignore[no-untyped-def]
    """Set the polynomial and the states e of one step, and move v (LANES,) to its end."""
    for lane in range(LANES):
        z = decay[lane] * length
        a_0 = gain[lane] * (voltage[0] - voltage[1] / z)
        a_1 = gain[lane] * voltage[1]
        r = charged[lane] - a_0
        polynomial[0, lane] = a_0 * a_0
        polynomial[1, lane] = 2.0 * a_0 * a_1
        polynomial[2, lane] = a_1 * a_1
        extra[0, lane] = 2.0 * r * a_0
        extra[1, lane] = 2.0 * r * a_1 / length
        extra[2, lane] = r * r
        charged[lane] = a_0 + a_1 + r * math.exp(-z)
