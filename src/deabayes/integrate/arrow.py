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

A kernel defines its right-hand side and Jacobian once, as functions of one stage, and calls them in
a loop over `STAGES` (`systems.membrane.kernel`). This module holds the parts that do not depend on
them: the first rows of every block (y_0, or one of the others), sums over earlier increments, step
sizes, dense output, and the loop over draws. A block is one flat array of rows x LANES. The
compiler then sees that rows do not overlap, and vectorises over the lanes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate import rodas5p as t
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, LANES, interpolate

IndexArray = NDArray[np.int64]
START, ARGUMENT, U1 = (row * LANES for row in range(3))
"""Offsets of the first rows of every block: the value at the start of the step, the argument of
the current stage, and the first of eight increments."""
SHARED_ROWS = 10
(
    STEP, OFFSET, SPAN, V0, V1, V2, V3, V4, V5, D1, D2, D3, D4, D5, D6, DRIFT,
    FORCE, SCHUR, PIVOT, ERROR, ALLOWED, FACTOR, K2, K3, K4,
) = ((SHARED_ROWS + r) * LANES for r in range(25))  # fmt: skip
"""Further rows of y_0's block: step; position in the piece of the excitation, 1/duration of the
piece, its coefficients; squared voltage at the different nodes, h times its slope at the start;
sums over the others, 1/pivot; step control; dense output."""
FIRST_CONSTANT = (SHARED_ROWS + 25) * LANES
"""Offset of the first of the draw's constants in y_0's block; in other blocks: SHARED_ROWS."""
DIFFERENT_NODES = 6
"""Number of different nodes in the tableau: stages 6 to 8 are at the end of the step."""
FIRST_AT_THE_END = 6
"""First of the stages at the end of the step, counted from 1. Every later stage has the argument
of the previous stage plus the previous stage's increment."""
LAST = U1 + (t.STAGES - 1) * LANES
STAGES = tuple(zip(t.A[1:-1], t.C[1:], t.A[2:], t.D[1:], strict=True))
"""Stages 2 to 8: weights of the increments in the argument of the stage, in its right-hand side,
and in the argument of the next stage; weight of the drift."""
OF_START, OF_STEP, OF_LOW, OF_HIGH, OF_ALLOWED, OF_CONSTANTS = range(6)
"""Columns of a draw: y_0 at the start, first step after a jump of the voltage, lowest and highest
allowed y_0, 1/allowed error, then the constants in the order of the rows."""
IDLE = -1
SAFETY = 0.9
LARGEST_GROWTH = 5.0
LARGEST_CUT = 0.1
STRIDE = 16
FINEST = 1e-10
"""Smallest step relative to the first step; a draw that needs a smaller step has failed."""


@dataclass(frozen=True)
class Motion:
    """Values of y_0 (W, N), steps tried (W,), and time when a draw failed (W,), NaN if not."""

    values: FloatArray
    steps: IndexArray
    ended: FloatArray

    @classmethod
    def empty(cls, draws: int, times: int) -> Self:
        """Return arrays for `integrate` to fill."""
        return cls(np.empty((draws, times)), np.empty(draws, dtype=np.int64), np.empty(draws))


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
def _enter_piece(
    c: FloatArray, i: int, edges: FloatArray, coefficients: FloatArray, piece: int
) -> None:
    """Load a piece of the excitation into lane `i`: 1/length and the coefficients."""
    c[SPAN + i] = 1.0 / (edges[piece + 1] - edges[piece])
    for power in range(coefficients.shape[1]):
        c[V0 + power * LANES + i] = coefficients[piece, power]


@njit(**KERNEL_OPTIONS)
def drive(c: FloatArray) -> None:
    """Compute the squared voltage at the nodes, and h times its slope at the start."""
    for i in range(LANES):
        x, dx = c[OFFSET + i], c[STEP + i] * c[SPAN + i]
        v0, v1, v2, v3, v4, v5 = (
            c[V0 + i], c[V1 + i], c[V2 + i], c[V3 + i], c[V4 + i], c[V5 + i],
        )  # fmt: skip
        v = v0 + x * (v1 + x * (v2 + x * (v3 + x * (v4 + x * v5))))
        slope = v1 + x * (2.0 * v2 + x * (3.0 * v3 + x * (4.0 * v4 + x * 5.0 * v5)))
        c[DRIFT + i] = 2.0 * v * slope * dx
        for node in range(DIFFERENT_NODES):
            a = x + t.NODES[node] * dx
            v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
            c[D1 + node * LANES + i] = v * v


@njit(**KERNEL_OPTIONS)
def finish(c: FloatArray) -> None:
    """Compute the dense output, the error over the allowed error, and the next step's factor."""
    for i in range(LANES):
        c[K2 + i] = combined(c, i, 0.0, t.H2)
        c[K3 + i] = combined(c, i, 0.0, t.H3)
        c[K4 + i] = combined(c, i, 0.0, t.H4)
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = growth(c[ERROR + i])


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


@njit(**KERNEL_OPTIONS)
def _load(
    c: FloatArray, blocks: FloatArray, second: int, i: int, draw: FloatArray, units: FloatArray
) -> None:
    """Load a draw and its units (n, columns) into lane `i`, at rest."""
    c[second + START + i] = 0.0
    c[START + i], c[ALLOWED + i] = draw[OF_START], draw[OF_ALLOWED]
    for row in range(draw.size - OF_CONSTANTS):
        c[FIRST_CONSTANT + row * LANES + i] = draw[OF_CONSTANTS + row]
    for n in range(units.shape[0]):
        blocks[n, START + i] = units[n, 0]
        for row in range(units.shape[1] - 1):
            blocks[n, (SHARED_ROWS + row) * LANES + i] = units[n, 1 + row]


# Not in Numba's cache: a function as an argument is another one in every process. The kernels that
# call this function are in the cache, and contain it.
@njit(inline="always", **{**KERNEL_OPTIONS, "cache": False})
def integrate(
    step: Any,
    second: int,
    c: FloatArray,
    blocks: FloatArray,
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draws: FloatArray,
    units: FloatArray,
    most_steps: int,
    values: FloatArray,
    steps: IndexArray,
    ended: FloatArray,
) -> None:
    """Compute y_0 of every draw at `times`, starting at rest.

    Parameters
    ----------
    step : compiled function of `c` and `blocks` that makes one step in every lane.
    second : offset in `c` of the block of y_0'; 0 if y_0' is no state.
    c : (rows LANES,) block of y_0 to work in; `blocks` (n, rows LANES) of the others.
    edges : (S + 1,) ends of the pieces of the excitation [s].
    volts : (S, 6) coefficients of the voltage [V] on a piece, in powers of its elapsed fraction.
    restart : (S,) whether the drive jumps or turns at the start of the piece (1) or not (0).
    times : (N,) ascending, from edges[0] to edges[S].
    draws : (W, columns); see OF_START.
    units : (W, n, columns): value at the start, then the constants in the order of the rows.
    most_steps : largest number of steps of a draw; a draw that needs more has failed.
    values : (W, N) result; a row of NaN if a draw leaves its limits or fails.
    steps : (W,) result: number of steps tried.
    ended : (W,) result: end of the step in which a draw left its limits, or end of the last
        accepted step of a draw that failed. NaN if a draw reached the last output.
    """
    walkers, end = draws.shape[0], times[times.size - 1]
    lane_draw = np.full(LANES, IDLE)
    piece, output = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    now, proposed = np.zeros(LANES), np.zeros(LANES)
    # This is one function for speed. Smaller functions with the lanes in tuples of arrays were
    # four to seven times slower. A function for the part after an accepted step was 1.4 to 1.6
    # times slower.
    waiting, running = 0, 0
    while True:
        for i in range(LANES):
            while lane_draw[i] == IDLE and waiting < walkers:
                w, waiting = waiting, waiting + 1
                steps[w], ended[w] = 0, np.nan
                if not usable(draws[w], units[w]):
                    values[w], ended[w] = np.nan, edges[0]
                    continue
                _load(c, blocks, second, i, draws[w], units[w])
                _enter_piece(c, i, edges, volts, 0)
                lane_draw[i], piece[i], output[i] = w, 0, 0
                now[i], proposed[i] = edges[0], draws[w, OF_STEP]
                running += 1
            if lane_draw[i] != IDLE:
                begin = edges[piece[i]]
                c[STEP + i] = fitted_step(proposed[i], edges[piece[i] + 1] - now[i])
                c[OFFSET + i] = (now[i] - begin) * c[SPAN + i]
        if running == 0:
            break
        step(c, blocks)
        for i in range(LANES):
            w = lane_draw[i]
            if w == IDLE:
                continue
            steps[w] += 1
            h, factor, first = c[STEP + i], c[FACTOR + i], draws[w, OF_STEP]
            lost = steps[w] > most_steps
            if c[ERROR + i] <= 1.0:
                after = edges[piece[i] + 1]
                last = h == after - now[i]
                reached = after if last else now[i] + h
                output[i] = write_outputs(
                    times, output[i], now[i], h, reached, c[START + i], c[ARGUMENT + i],
                    c[K2 + i], c[K3 + i], c[K4 + i], values[w],
                )  # fmt: skip
                c[START + i], c[second + START + i] = c[ARGUMENT + i], c[second + ARGUMENT + i]
                for n in range(units.shape[1]):
                    blocks[n, START + i] = blocks[n, ARGUMENT + i]
                now[i] = reached
                proposed[i] = max(h * factor, proposed[i]) if h < proposed[i] else h * factor
                lost |= not draws[w, OF_LOW] <= c[START + i] <= draws[w, OF_HIGH]
                if not lost and (output[i] == times.size or reached >= end):
                    lane_draw[i], running = IDLE, running - 1
                elif last and not lost:
                    piece[i] += 1
                    _enter_piece(c, i, edges, volts, piece[i])
                    if restart[piece[i]] > 0.0:
                        proposed[i] = min(proposed[i], first)
            else:
                proposed[i] = h * min(factor, 0.8)
                lost |= proposed[i] < FINEST * first
            if lost and lane_draw[i] != IDLE:
                values[w], ended[w] = np.nan, now[i]
                lane_draw[i], running = IDLE, running - 1
