r"""Rodas5P for an arrow Jacobian, lanes of draws that each keep their own time.

One quantity y_0 is coupled to every other; the others only to y_0 and themselves:

    J = [[a, b_1 ... b_n], [c_1, d_1, 0 ...], ..., [c_n, 0 ..., d_n]]

so that a stage (1/GAMMA - h J) u = r is a scalar Schur complement. With the pivots
m_k = 1/GAMMA - h d_k:

    u_0 = (r_0 + sum_k (h b_k/m_k) r_k) / (1/GAMMA - h a - sum_k (h b_k/m_k) h c_k)
    u_k = (r_k + h c_k u_0) / m_k

A group of LANES draws runs in lockstep, one step of each at a time, but every lane has
its own time, step size and excitation piece, and takes the next draw when it has finished
its own: a draw's steps depend on that draw alone, and a lane that fails changes no other.

A kernel writes its right-hand side and Jacobian once, and makes its eight stages from the
tableau in a loop (`systems.membrane.kernel`). This module holds what does not depend on them:
the rows that every block (y_0, or one of the others) begins with, sums over earlier increments,
step sizes, and dense output. Blocks are flat arrays of rows x LANES: from one base address the
compiler sees that rows do not overlap, and makes vectors of the lanes.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, interpolate

LANES = 32
START, ARGUMENT, U1 = (row * LANES for row in range(3))
"""Offsets of the rows all blocks begin with: value at the start of the step, argument of
the current stage, the first of eight increments."""
SHARED_ROWS = 10
FIRST_AT_THE_END = 6
"""Later stages too: each is at the argument of the stage before plus its increment."""
SAFETY = 0.9
LARGEST_GROWTH = 5.0
LARGEST_CUT = 0.1
STRIDE = 16
FINEST = 1e-10
"""Of the first step: a draw that needs smaller steps has failed."""


@njit(**KERNEL_OPTIONS)
def combined(w: FloatArray, i: int, start: float, weights: tuple[float, ...]) -> float:
    """Start + sum_j weights_j u_j of the block `w`, lane `i`: a row of A, C or H times increments.

    The number of weights is part of the compiled type, so that the loop is unrolled.
    """
    for j in range(len(weights)):
        start += weights[j] * w[U1 + j * LANES + i]
    return start


@njit(**KERNEL_OPTIONS)
def growth(error: float) -> float:
    """Factor to the next step size; `error` is the estimate over what is allowed.

    The estimate is of order h^5; error^-3/16 stands for error^-1/5 because square roots
    make vectors of the lanes. NaN (a stage left the model's domain) is the largest cut.
    """
    fourth = np.sqrt(np.sqrt(max(error, 1e-8)))
    factor = SAFETY * np.sqrt(np.sqrt(fourth)) / fourth
    return min(LARGEST_GROWTH, max(LARGEST_CUT, factor)) if error < 1e8 else LARGEST_CUT


@njit(**KERNEL_OPTIONS)
def fitted_step(proposed: float, remaining: float) -> float:
    """A step that ends at the end of the piece, or leaves room for at least half of itself."""
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
    """Put a piece of the excitation into lane `i`: 1/its length in the row `span`, its
    coefficients in the rows from `first` on."""
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
    """Dense output at the `times` (N,) from index `first` on and not after `end`.

    Writes into `row` (N,); returns the index of the first output still to come.
    """
    last = first
    while last + STRIDE <= times.size and times[last + STRIDE - 1] <= end:
        last += STRIDE
    while last < times.size and times[last] <= end:
        last += 1
    inverse = 1.0 / step
    # Slices: indices that cannot be negative make a vector of the outputs.
    here, found = times[first:last], row[first:last]
    for o in range(here.size):
        found[o] = interpolate((here[o] - begin) * inverse, y, y_end, k2, k3, k4)
    return last
