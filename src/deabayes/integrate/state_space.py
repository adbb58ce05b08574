r"""Linear systems z' = A z + B w, y = C z + D w, one per draw, and their exact response.

Between the knots of a `Hold` the input w is a polynomial, so a step has no discretisation
error (see `linear.fill_propagator`). Steps of equal length share their propagators: an evenly
sampled record costs one pair of matrix products per sample. Uneven records also cost a matrix
exponential per sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.linear import LANES, Hold, fill_propagator, in_lanes


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

    def transfer(self, rate: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """C (s - A)^-1 B + D (W, R) at the complex rates s (R,) [1/s]."""
        resolvent = rate[:, None, None] * np.eye(self.b.shape[1]) - self.a[:, None]
        column = np.broadcast_to(self.b[:, None, :, None], (*resolvent.shape[:3], 1))
        states = np.linalg.solve(resolvent, column)[..., 0]
        return np.einsum("wn,wrn->wr", self.c, states) + self.d[:, None]

    def zero_order_hold(self, step: float) -> StateSpace:
        """Exact systems z[k+1] = A' z[k] + B' w[k] for an input held for `step` [s].

        A' = exp(A h), B' = (integral of exp(A s) over [0, h]) B, by `linear.fill_propagator`.
        C and D do not change. A draw whose matrices are not finite gives NaN.
        """
        a, b = np.empty_like(self.a), np.empty_like(self.b)
        _fill_held(np.ascontiguousarray(self.a), np.ascontiguousarray(self.b), step, a, b)
        return StateSpace(a, b, self.c, self.d)

    def response(self, load: Hold, start: FloatArray | None = None) -> FloatArray:
        """Output (W, N) for an input that starts at the first knot.

        Parameters
        ----------
        load : the input; common to all draws.
        start : (W, n) state at the first knot or output, whichever is earlier; at rest
            by default.

        Returns
        -------
        ndarray
            (W, N). A draw whose matrices are not finite gives a row of NaN; no draw
            changes another's row.
        """
        walkers, states = self.b.shape
        blocks = -(-walkers // LANES)
        start = np.zeros_like(self.b) if start is None else start
        response = np.empty((blocks * LANES, load.input.size))
        # All blocks have LANES draws, so the result of a draw does not depend on the others.
        _advance(
            load.lengths,
            load.length_index,
            load.polynomials,
            load.output_index,
            load.input,
            in_lanes(self.a.reshape(walkers, states * states), blocks),
            in_lanes(np.column_stack([self.b, self.c, self.d, start]), blocks),
            response,
        )
        return response[:walkers]


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
def fill_lanes(lengths, matrix, vectors, steps, drives) -> None:  # type: ignore[no-untyped-def]
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
    lengths, length_index, polynomials, output_index, load, matrices, vectors, response
) -> None:
    """Fill response (blocks * LANES, N), one block of lanes after another.

    matrices (blocks, n n, LANES) hold A, vectors (blocks, 3 n + 1, LANES) B, C, D and the
    state at the start.
    """
    states = (vectors.shape[1] - 1) // 3
    steps = np.empty((lengths.size, states, states, LANES))
    drives = np.empty((lengths.size, states, 3, LANES))
    outputs = np.empty((length_index.size + 1, LANES))
    state, after = np.empty((states, LANES)), np.empty((states, LANES))
    polynomial = np.empty((3, LANES))
    for block in range(vectors.shape[0]):
        weights, direct = vectors[block, states : 2 * states], vectors[block, 2 * states]
        fill_lanes(lengths, matrices[block], vectors[block], steps, drives)
        state[:] = vectors[block, 2 * states + 1 :]
        output_lanes(weights, state, outputs[0])
        for s in range(length_index.size):
            c = length_index[s]
            for power in range(3):
                polynomial[power] = polynomials[s, power]
            step_lanes(steps[c], drives[c], polynomial, state, after)
            state, after = after, state
            output_lanes(weights, state, outputs[s + 1])
        for i in range(output_index.size):
            for lane in range(LANES):
                response[block * LANES + lane, i] = (
                    outputs[output_index[i], lane] + direct[lane] * load[i]
                )


@njit(cache=True)
def step_lanes(step, drive, polynomial, state, after) -> None:  # type: ignore[no-untyped-def]
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
def output_lanes(weights, state, output) -> None:  # type: ignore[no-untyped-def]
    """Set `output` to C z, lane by lane."""
    output[:] = 0.0
    for i in range(state.shape[0]):
        for lane in range(LANES):
            output[lane] += weights[i, lane] * state[i, lane]
