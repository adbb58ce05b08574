r"""Linear systems z' = A z + B w, y = C z + D w, one per draw, and their exact response.

Between the knots of a `Hold` the input w is a polynomial, so a step has no discretisation
error (see `fill_propagator`). Steps of equal length share their propagators: an evenly
sampled record costs one pair of matrix products per sample. Uneven records also cost a matrix
exponential per sample.

The input may also be w = v^2 with a voltage v that charges by v' = kappa (g V - v), where V is
linear between its knots. On a step of length h (u = s / h) with V = p0 + p1 u,

v = a_0 + a_1 u + r exp(-kappa s),   a_0 = g (p0 - p1 / (kappa h)),   a_1 = g p1,   r = v(0) - a_0,
w = a_0^2 + 2 a_0 a_1 u + a_1^2 u^2 + 2 r (a_0 + a_1 u) exp(-kappa s) + r^2 exp(-2 kappa s).

The exponential part of w is the sum e_1 + e_3 of the states

e_1' = -kappa e_1 + e_2,   e_2' = -kappa e_2,   e_3' = -2 kappa e_3,

which are added to the system and set at the start of every step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.linear import LANES, Hold, in_lanes

SMALL_NORM = 0.5
TERMS = 16
"""Terms of the series; the last is at most SMALL_NORM^16 / 16! = 7e-19."""
MOST_DOUBLINGS = 60
OF_CHARGE = 3
"""Number of states that a charging voltage adds."""


@dataclass(frozen=True)
class StateSpace:
    """Single-input, single-output linear systems.

    Attributes
    ----------
    a : A (W, n, n).
    b : B (W, n).
    c : C (W, n).
    d : D (W,).
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    def zero_order_hold(self, step: float) -> StateSpace:
        """Exact systems z[k+1] = A' z[k] + B' w[k] for an input held for `step` [s].

        A' = exp(A h), B' = (integral of exp(A s) over [0, h]) B, by `fill_propagator`.
        C and D do not change. A draw whose matrices are not finite gives NaN.
        """
        a, b = np.empty_like(self.a), np.empty_like(self.b)
        _fill_held(np.ascontiguousarray(self.a), np.ascontiguousarray(self.b), step, a, b)
        return StateSpace(a, b, self.c, self.d)

    def response(
        self, load: Hold, gain: FloatArray | None = None, decay: FloatArray | None = None
    ) -> FloatArray:
        """Output (W, N) for an input that starts at the first knot; the system is at rest before.

        Parameters
        ----------
        load : the input w, common to all draws; with gain and decay V, held with power 1.
        gain, decay : g and kappa [1/s] (W,) of a voltage that charges from zero.

        Returns
        -------
        ndarray
            (W, N). A draw whose matrices are not finite, or whose decay is not positive, gives a
            row of NaN; no draw changes another's row.
        """
        whole, circuit = self, np.zeros((self.d.size, 2))
        if gain is not None and decay is not None:
            decay = np.where(decay > 0.0, decay, np.nan)
            whole, circuit = self._with_charge(decay), np.column_stack([gain, decay])
        walkers = self.d.size
        blocks = -(-walkers // LANES)
        response = np.empty((blocks * LANES, load.input.size))
        # All blocks have LANES draws, so the result of a draw does not depend on the others.
        _advance(
            load.lengths,
            load.length_index,
            load.polynomials,
            load.output_index,
            load.input,
            in_lanes(whole.a.reshape(walkers, -1), blocks),
            in_lanes(np.column_stack([whole.b, whole.c, whole.d, circuit]), blocks),
            whole is not self,
            response,
        )
        return response[:walkers]

    def _with_charge(self, decay: FloatArray) -> StateSpace:
        """Return the systems with the states e_1, e_2, e_3, for kappa (W,)."""
        walkers, states = self.b.shape
        a = np.zeros((walkers, states + OF_CHARGE, states + OF_CHARGE))
        a[:, :states, :states] = self.a
        a[:, :states, states] = a[:, :states, states + 2] = self.b
        a[:, states, states] = a[:, states + 1, states + 1] = -decay
        a[:, states, states + 1] = 1.0
        a[:, states + 2, states + 2] = -2.0 * decay
        none = np.zeros((walkers, OF_CHARGE))
        return replace(self, a=a, b=np.hstack([self.b, none]), c=np.hstack([self.c, none]))


@njit(cache=True)
def _fill_held(matrices, vectors, length, a, b) -> None:  # type: ignore[no-untyped-def]
    """Fill a with exp(A h) (W, n, n) and b with the weights of a constant input (W, n)."""
    states = vectors.shape[1]
    scratch = np.empty((2, states, states + 1))
    drive = np.empty((states, 3))
    for draw in range(vectors.shape[0]):
        fill_propagator(matrices[draw], vectors[draw], length, scratch, a[draw], drive)
        b[draw] = drive[:, 0]
        for i in range(states):
            a[draw, i, i] += 1.0


@njit(cache=True)
def _fill_lanes(lengths, matrix, vectors, steps, drives) -> None:  # type: ignore[no-untyped-def]
    """Fill the propagators (C, n, n, LANES) and (C, n, 3, LANES) of a block for every length."""
    states = drives.shape[1]
    a, b = np.empty((states, states)), np.empty(states)
    scratch = np.empty((2, states, states + 1))
    step, drive = np.empty((states, states)), np.empty((states, 3))
    for lane in range(LANES):
        for i in range(states):
            b[i] = vectors[i, lane]
            for j in range(states):
                a[i, j] = matrix[i * states + j, lane]
        for c in range(lengths.size):
            fill_propagator(a, b, lengths[c], scratch, step, drive)
            steps[c, :, :, lane] = step
            drives[c, :, :, lane] = drive


@njit(cache=True)
def _advance(  # type: ignore[no-untyped-def]
    lengths, length_index, polynomials, output_index, load, matrices, vectors, charges, response
) -> None:
    """Fill response (blocks * LANES, N), one block of lanes after another.

    matrices (blocks, n n, LANES) hold A, vectors (blocks, 2 n + 3, LANES) B, C, D, g, kappa.
    """
    states = (vectors.shape[1] - 3) // 2
    steps = np.empty((lengths.size, states, states, LANES))
    drives = np.empty((lengths.size, states, 3, LANES))
    outputs = np.empty((length_index.size + 1, LANES))
    state, after = np.empty((states, LANES)), np.empty((states, LANES))
    polynomial, charged = np.empty((3, LANES)), np.empty(LANES)
    for block in range(vectors.shape[0]):
        weights, direct = vectors[block, states : 2 * states], vectors[block, 2 * states]
        gain, decay = vectors[block, 2 * states + 1], vectors[block, 2 * states + 2]
        _fill_lanes(lengths, matrices[block], vectors[block], steps, drives)
        state[:], charged[:], outputs[0] = 0.0, 0.0, 0.0
        for s in range(length_index.size):
            c = length_index[s]
            if charges:
                _charge(polynomials[s], lengths[c], gain, decay, charged, polynomial, state[-3:])
            else:
                for power in range(3):
                    polynomial[power] = polynomials[s, power]
            _step_lanes(steps[c], drives[c], polynomial, state, after)
            state, after = after, state
            outputs[s + 1] = direct * charged * charged
            for i in range(states):
                outputs[s + 1] += weights[i] * state[i]
        for i in range(output_index.size):
            for lane in range(LANES):
                fed = 0.0 if charges else direct[lane] * load[i]  # v^2 does not jump
                response[block * LANES + lane, i] = outputs[output_index[i], lane] + fed


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


@njit(cache=True)
def _step_lanes(step, drive, polynomial, state, after) -> None:  # type: ignore[no-untyped-def]
    """Set `after` to the state after one step with the input's polynomial (3, LANES)."""
    for i in range(state.shape[0]):
        for lane in range(LANES):
            after[i, lane] = (
                state[i, lane]
                + polynomial[0, lane] * drive[i, 0, lane]
                + polynomial[1, lane] * drive[i, 1, lane]
                + polynomial[2, lane] * drive[i, 2, lane]
            )
        for j in range(state.shape[0]):
            for lane in range(LANES):
                after[i, lane] += step[i, j, lane] * state[j, lane]


@njit(cache=True)
def fill_propagator(a, b, length, scratch, step, drive) -> None:  # type: ignore[no-untyped-def]
    """Fill E = exp(A h) - I (n, n) and the input's weights G (n, 3) for one step length h.

    A is (n, n) and B (n,). E and G are NaN if A h is not finite or far too large.
    scratch (2, n, n + 1) is overwritten.
    """
    doublings = _doublings(a, length)
    if doublings < 0:
        step[:] = math.nan
        drive[:] = math.nan
        return
    _series(a, b, length * 2.0**-doublings, scratch, step, drive)
    for _ in range(doublings):
        _double(scratch[0], step, drive)


@njit(cache=True)
def _doublings(a, length) -> int:  # type: ignore[no-untyped-def]
    """Halvings that bring the maximum norm of A h to SMALL_NORM; -1 if too many or not finite."""
    norm = 0.0
    for i in range(a.shape[0]):
        total = 0.0
        for j in range(a.shape[0]):
            total += abs(a[i, j])
        if not total * length < SMALL_NORM * 2.0**MOST_DOUBLINGS:
            return -1
        norm = max(norm, total * length)
    return 0 if norm <= SMALL_NORM else math.ceil(math.log2(norm / SMALL_NORM))


@njit(cache=True)
def _series(a, b, h, scratch, step, drive) -> None:  # type: ignore[no-untyped-def]
    """Sum the series of E and G; the last column of `term` is (A h)^j B h / j!."""
    size = a.shape[0]
    term, after = scratch[0], scratch[1]
    step[:] = 0.0
    drive[:] = 0.0
    for i in range(size):
        for j in range(size):
            term[i, j] = 1.0 if i == j else 0.0
        term[i, size] = h * b[i]
    for order in range(TERMS):
        for i in range(size):
            share = term[i, size] / (order + 1.0)
            drive[i, 0] += share
            drive[i, 1] += share / (order + 2.0)
            drive[i, 2] += 2.0 * share / ((order + 2.0) * (order + 3.0))
            for j in range(size + 1):
                total = 0.0
                for k in range(size):
                    total += a[i, k] * term[k, j]
                after[i, j] = h * total / (order + 1.0)
                if j < size:
                    step[i, j] += after[i, j]
        term, after = after, term


@njit(cache=True)
def _double(product, step, drive) -> None:  # type: ignore[no-untyped-def]
    """Replace the propagators by those of twice the step; product (n, n + 1) is overwritten."""
    size = step.shape[0]
    for k in range(2, -1, -1):
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += step[i, j] * drive[j, k]
            product[i, 0] = total
        for i in range(size):
            g_0, g_1, g_2 = drive[i, 0], drive[i, 1], drive[i, 2]
            if k == 0:
                drive[i, 0] = product[i, 0] + 2.0 * g_0
            elif k == 1:
                drive[i, 1] = 0.5 * (product[i, 0] + 2.0 * g_1 + g_0)
            else:
                drive[i, 2] = 0.25 * (product[i, 0] + 2.0 * g_2 + 2.0 * g_1 + g_0)
    for i in range(size):
        for j in range(size):
            total = 2.0 * step[i, j]
            for k in range(size):
                total += step[i, k] * step[k, j]
            product[i, j] = total
    for i in range(size):
        for j in range(size):
            step[i, j] = product[i, j]
