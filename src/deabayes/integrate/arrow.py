r"""Rodas5P for an arrow Jacobian, for many draws at once with step sizes of their own.

The quantity y_0 is coupled to all others; every other quantity only to y_0 and itself:

    J = [[a, b_1 ... b_n], [c_1, d_1, 0 ...], ..., [c_n, 0 ..., d_n]]

A scalar Schur complement therefore solves a stage (1/GAMMA - h J) u = r. With the pivots
m_k = 1/GAMMA - h d_k:

    u_0 = (r_0 + sum_k (h b_k/m_k) r_k) / (1/GAMMA - h a - sum_k (h b_k/m_k) h c_k)
    u_k = (r_k + h c_k u_0) / m_k

LANES draws advance together, one step each at a time. Every lane has its own time, step size and
excitation piece, and takes the next draw when its own draw is finished. The steps of a draw
therefore depend on that draw alone, and a lane that fails does not change the others.

A kernel defines its right-hand side and Jacobian once, and loops over the eight stages of the
tableau (`systems.membrane.kernel`). This module holds the parts that do not depend on them: the
first rows of every block (y_0, or one of the others), sums over earlier increments, step sizes,
and dense output. A block is one flat array of rows x LANES. The compiler then sees that rows do
not overlap, and vectorises over the lanes.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, interpolate

LANES = 32
START, ARGUMENT, U1 = (row * LANES for row in range(3))
"""Offsets of the first rows of every block: the value at the start of the step, the argument of
the current stage, and the first of eight increments."""
SHARED_ROWS = 10
FIRST_AT_THE_END = 6
"""First of the stages at the end of the step, counted from 1. Every later stage has the argument
of the previous stage plus the previous stage's increment."""
SAFETY = 0.9
LARGEST_GROWTH = 5.0
LARGEST_CUT = 0.1
STRIDE = 16
FINEST = 1e-10
"""Smallest step relative to the first step; a draw that needs a smaller step has failed."""


@njit(**KERNEL_OPTIONS)
def combined(w: FloatArray, i: int, start: float, weights: tuple[float, ...]) -> float:
    """Start + sum_j weights_j u_j of block `w`, lane `i`; weights are a row of A, C or H.

    The number of weights is part of the compiled type, so the compiler unrolls the loop.
    """
    for j in range(len(weights)):
        start += weights[j] * w[U1 + j * LANES + i]
    return start


@njit(**KERNEL_OPTIONS)
def growth(error: float) -> float:
    """Factor to the next step size; `error` is the error estimate over the allowed error.

    The estimate is of order h^5. error^-3/16 replaces error^-1/5, because square roots can be
    vectorised. NaN (a stage left the model's domain) gives the largest cut.
    """
    fourth = np.sqrt(np.sqrt(max(error, 1e-8)))
    factor = SAFETY * np.sqrt(np.sqrt(fourth)) / fourth
    return min(LARGEST_GROWTH, max(LARGEST_CUT, factor)) if error < 1e8 else LARGEST_CUT


@njit(**KERNEL_OPTIONS)
def fitted_step(proposed: float, remaining: float) -> float:
    """Return a step that ends with the piece, or leaves at least half a step to its end."""
    if 1.05 * proposed >= remaining:
        return remaining
    return min(proposed, 0.55 * remaining)


@njit(**KERNEL_OPTIONS)
def usable(draw: FloatArray, units: FloatArray) -> bool:
    """Whether all constants of a draw and of its units are finite."""
    total = 0.0
    for value in draw:
        total += 0.0 * value
    for n in range(units.shape[0]):
        for value in units[n]:
            total += 0.0 * value
    return total == 0.0


@njit(**KERNEL_OPTIONS)
def enter_piece(
    c: FloatArray,
    i: int,
    span: int,
    first: int,
    edges: FloatArray,
    coefficients: FloatArray,
    piece: int,
) -> None:
    """Load a piece of the excitation into lane `i`.

    1/length goes to the row `span`, the coefficients to the rows from `first` on.
    """
    c[span + i] = 1.0 / (edges[piece + 1] - edges[piece])
    for power in range(coefficients.shape[1]):
        c[first + power * LANES + i] = coefficients[piece, power]


@njit(**KERNEL_OPTIONS)
def write_outputs(
    times: FloatArray,
    first: int,
    begin: float,
    step: float,
    end: float,
    y: float,
    y_end: float,
    k2: float,
    k3: float,
    k4: float,
    row: FloatArray,
) -> int:
    """Write the dense output at `times` (N,) from index `first` on, up to the time `end`.

    The output goes to `row` (N,). Return the index of the first output not yet written.
    """
    last = first
    while last + STRIDE <= times.size and times[last + STRIDE - 1] <= end:
        last += STRIDE
    while last < times.size and times[last] <= end:
        last += 1
    inverse = 1.0 / step
    # Indices into slices cannot be negative, so the compiler vectorises over the outputs.
    here, found = times[first:last], row[first:last]
    for o in range(here.size):
        found[o] = interpolate((here[o] - begin) * inverse, y, y_end, k2, k3, k4)
    return last
