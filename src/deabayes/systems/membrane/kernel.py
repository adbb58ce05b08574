"""Compiled Rodas5P integration of the membrane without inertia, for a group of draws at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START, U1
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS

IndexArray = NDArray[np.int64]
UnitStage = Callable[[FloatArray, FloatArray], None]
StretchStage = Callable[[FloatArray], None]
DIFFERENT_NODES = 6
"""Number of different nodes in the tableau: stages 6 to 8 are at the end of the step."""
FLUIDITY, MODULUS, INVERSE, WEIGHT = ((arrow.SHARED_ROWS + r) * LANES for r in range(4))
"""Rows of all blocks: 1/tau or 1/zeta_alpha, mu, 1/J, weight of the error."""
RATE, FORCE_RATE, SOLVE, COUPLE, PULL, RIGHT = (
    (arrow.SHARED_ROWS + r) * LANES for r in range(4, 10)
)
"""Rows of a unit: h/tau, h mu/zeta_alpha, 1/m_k, h c_k/m_k, h b_k/m_k, r_k/m_k."""
UNIT_ROWS = arrow.SHARED_ROWS + 10
(
    SIGMA, GAIN, ALLOWED, STEP, HZ, D1, D2, D3, D4, D5, D6, DRIFT,
    FORCE, SCHUR, PIVOT, ERROR, FACTOR, K2, K3, K4, OFFSET, SPAN, V0, V1, V2, V3, V4, V5,
) = ((arrow.SHARED_ROWS + r) * LANES for r in range(4, 32))  # fmt: skip
"""Rows of lambda's block: constants of the draw; step and h/zeta_alpha; drive at the nodes
and its slope times h^2; sums over the units; step control; dense output; position in the piece
of the excitation, 1/duration of the piece, its coefficients."""
STRETCH_ROWS = arrow.SHARED_ROWS + 32
DEGREE = 5
"""Degree of the voltage as a polynomial in time on a piece."""


@njit(**KERNEL_OPTIONS)
def resistance(lam: float, xi: float, q: float) -> float:
    """Return R(lambda, xi); NaN outside the Gent limit."""
    square, x = lam * lam, xi * xi
    cube, xcube = square * square * square, x * x * x
    b = x * square * square * (1.0 + 3.0 * q) - q * (2.0 * cube + xcube)
    below = lam * xi * b
    return (cube - xcube) / below if (b > 0.0) & (below > 0.0) else np.nan


@njit(**KERNEL_OPTIONS)
def slopes(lam: float, xi: float, q: float) -> tuple[float, float, float]:
    """Return R and its derivatives with respect to lambda and xi."""
    lam2, x = lam * lam, xi * xi
    lam4, x2 = lam2 * lam2, x * x
    stiff = 1.0 + 3.0 * q
    b = x * lam4 * stiff - q * (2.0 * lam4 * lam2 + x2 * x)
    below = lam * xi * b
    inverse = 1.0 / below if (b > 0.0) & (below > 0.0) else np.nan
    r = (lam4 * lam2 - x2 * x) * inverse
    by_lam = 6.0 * lam * lam4 - r * xi * (b + 4.0 * lam4 * (x * stiff - 3.0 * q * lam2))
    by_xi = 6.0 * xi * x2 + r * lam * (b + 2.0 * x * (lam4 * stiff - 3.0 * q * x2))
    return r, by_lam * inverse, -by_xi * inverse


@njit(**KERNEL_OPTIONS)
def drive(c: FloatArray) -> None:
    """Compute h/zeta_alpha, and the drive at the nodes with its slope."""
    for i in range(LANES):
        h = c[STEP + i]
        c[HZ + i] = h * c[FLUIDITY + i]
        x, dx = c[OFFSET + i], h * c[SPAN + i]
        v0, v1, v2, v3 = c[V0 + i], c[V1 + i], c[V2 + i], c[V3 + i]
        v4, v5, gain = c[V4 + i], c[V5 + i], c[GAIN + i]
        v = v0 + x * (v1 + x * (v2 + x * (v3 + x * (v4 + x * v5))))
        slope = v1 + x * (2.0 * v2 + x * (3.0 * v3 + x * (4.0 * v4 + x * 5.0 * v5)))
        c[DRIFT + i] = c[HZ + i] * 2.0 * gain * v * slope * dx
        for node in range(DIFFERENT_NODES):
            a = x + t.NODES[node] * dx
            v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
            c[D1 + node * LANES + i] = gain * v * v


@njit(**KERNEL_OPTIONS)
def _unit_begins(w: FloatArray, c: FloatArray) -> None:
    """Compute the Jacobian and the first stage of a unit."""
    for i in range(LANES):
        lam, xi = c[START + i], w[START + i]
        r, by_lam, by_xi = slopes(lam, xi, w[INVERSE + i])
        rate, force_rate = c[STEP + i] * w[FLUIDITY + i], c[HZ + i] * w[MODULUS + i]
        solve = 1.0 / (1.0 / t.GAMMA - rate * lam * by_xi)
        below = rate * (r + lam * by_lam)
        pull = -force_rate * (r + xi * by_xi) * solve
        right = rate * lam * r
        w[RATE + i], w[FORCE_RATE + i], w[SOLVE + i] = rate, force_rate, solve
        w[COUPLE + i], w[PULL + i], w[RIGHT + i] = below * solve, pull, right * solve
        c[PIVOT + i] += pull * below - force_rate * xi * by_lam
        c[FORCE + i] += force_rate * xi * r
        c[SCHUR + i] += pull * right


def _unit_stage(stage: int) -> UnitStage:
    """Return a function for a unit: increment of the stage before, right-hand side of this one."""
    before, weights, history = U1 + (stage - 2) * LANES, t.A[stage - 1], t.C[stage - 1]
    kept, added = stage >= arrow.FIRST_AT_THE_END, stage > arrow.FIRST_AT_THE_END

    @njit(**KERNEL_OPTIONS)
    def unit_stage(w: FloatArray, c: FloatArray) -> None:
        for i in range(LANES):
            w[before + i] = w[RIGHT + i] + w[COUPLE + i] * c[before + i]
            if added:
                xi = w[ARGUMENT + i] + w[before + i]
            else:
                xi = arrow.combined(w, i, w[START + i], weights)
            if kept:
                w[ARGUMENT + i] = xi
            lam = c[ARGUMENT + i]
            r = resistance(lam, xi, w[INVERSE + i])
            right = w[RATE + i] * lam * r + arrow.combined(w, i, 0.0, history)
            w[RIGHT + i] = right * w[SOLVE + i]
            c[FORCE + i] += w[FORCE_RATE + i] * xi * r
            c[SCHUR + i] += w[PULL + i] * right

    return unit_stage


@njit(**KERNEL_OPTIONS)
def _unit_ends(w: FloatArray, c: FloatArray) -> None:
    """Compute a unit's value at the end of the step and its error."""
    last = U1 + (t.STAGES - 1) * LANES
    for i in range(LANES):
        increment = w[RIGHT + i] + w[COUPLE + i] * c[last + i]
        w[ARGUMENT + i] += increment
        c[ERROR + i] += w[WEIGHT + i] * abs(increment)


@njit(**KERNEL_OPTIONS)
def _stretch_begins(c: FloatArray) -> None:
    """Compute the pivot and the first stage of lambda; clear the sums over the units."""
    for i in range(LANES):
        lam, hz = c[START + i], c[HZ + i]
        r, by_lam, _ = slopes(lam, 1.0, c[INVERSE + i])
        square = lam * lam
        diagonal = hz * (3.0 * c[D1 + i] * square - c[MODULUS + i] * by_lam)
        solve = 1.0 / (1.0 / t.GAMMA - diagonal - c[PIVOT + i])
        flow = hz * (c[D1 + i] * square * lam + c[SIGMA + i] - c[MODULUS + i] * r)
        c[DRIFT + i] *= square * lam
        u = solve * (flow - c[FORCE + i] + c[SCHUR + i] + t.D1 * c[DRIFT + i])
        c[PIVOT + i], c[U1 + i], c[FORCE + i], c[SCHUR + i] = solve, u, 0.0, 0.0
        c[ARGUMENT + i] = arrow.combined(c, i, c[START + i], t.A[1])


def _stretch_stage(stage: int) -> StretchStage:
    """Return a function for lambda: increment of this stage, argument of the next."""
    here, node = U1 + (stage - 1) * LANES, D1 + min(stage - 1, DIFFERENT_NODES - 1) * LANES
    history, of_drift, weights = t.C[stage - 1], t.D[stage - 1], t.A[stage]
    at_the_end = stage >= arrow.FIRST_AT_THE_END

    @njit(**KERNEL_OPTIONS)
    def stretch_stage(c: FloatArray) -> None:
        for i in range(LANES):
            lam = c[ARGUMENT + i]
            r = resistance(lam, 1.0, c[INVERSE + i])
            flow = c[HZ + i] * (c[node + i] * lam * lam * lam + c[SIGMA + i] - c[MODULUS + i] * r)
            before = 0.0 if at_the_end else of_drift * c[DRIFT + i]
            earlier = arrow.combined(c, i, before, history)
            c[here + i] = c[PIVOT + i] * (flow - c[FORCE + i] + c[SCHUR + i] + earlier)
            c[FORCE + i], c[SCHUR + i] = 0.0, 0.0
            if at_the_end:
                c[ARGUMENT + i] += c[here + i]
            else:
                c[ARGUMENT + i] = arrow.combined(c, i, c[START + i], weights)

    return stretch_stage


@njit(**KERNEL_OPTIONS)
def _stretch_ends(c: FloatArray) -> None:
    """Compute the error of lambda, and the dense output."""
    for i in range(LANES):
        c[ERROR + i] = abs(c[U1 + (t.STAGES - 1) * LANES + i])
        c[PIVOT + i] = 0.0
        c[K2 + i] = arrow.combined(c, i, 0.0, t.H2)
        c[K3 + i] = arrow.combined(c, i, 0.0, t.H3)
        c[K4 + i] = arrow.combined(c, i, 0.0, t.H4)


@njit(**KERNEL_OPTIONS)
def _control(c: FloatArray) -> None:
    """Compute the error relative to the allowed error, and the factor for the next step size."""
    for i in range(LANES):
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = arrow.growth(c[ERROR + i])


_unit_2, _unit_3, _unit_4, _unit_5, _unit_6, _unit_7, _unit_8 = map(_unit_stage, range(2, 9))
_stretch_2, _stretch_3, _stretch_4, _stretch_5, _stretch_6, _stretch_7, _stretch_8 = map(
    _stretch_stage, range(2, 9)
)


@njit(**KERNEL_OPTIONS)
def step(c: FloatArray, units: FloatArray) -> None:
    """Make one step in every lane: lambda's block `c` and the blocks of the `units` (n, ...)."""
    n = units.shape[0]
    drive(c)
    for u in range(n):
        _unit_begins(units[u], c)
    _stretch_begins(c)
    for u in range(n):
        _unit_2(units[u], c)
    _stretch_2(c)
    for u in range(n):
        _unit_3(units[u], c)
    _stretch_3(c)
    for u in range(n):
        _unit_4(units[u], c)
    _stretch_4(c)
    for u in range(n):
        _unit_5(units[u], c)
    _stretch_5(c)
    for u in range(n):
        _unit_6(units[u], c)
    _stretch_6(c)
    for u in range(n):
        _unit_7(units[u], c)
    _stretch_7(c)
    for u in range(n):
        _unit_8(units[u], c)
    _stretch_8(c)
    _stretch_ends(c)
    for u in range(n):
        _unit_ends(units[u], c)
    _control(c)


DRAW_COLUMNS = 9
OF_FLUIDITY, OF_MODULUS, OF_INVERSE, OF_SIGMA, OF_GAIN = range(5)
OF_ALLOWED, OF_START, OF_LIMIT, OF_STEP = range(5, DRAW_COLUMNS)
"""Columns of a draw: 1/zeta_alpha, mu_alpha, 1/J_alpha, sigma, epsilon/H^2, 1/allowed error,
pre-stretch, largest stretch, first step after a jump of the voltage."""
IDLE = -1
MOST_STEPS = 20_000


@njit(**KERNEL_OPTIONS)
def _load(c: FloatArray, blocks: FloatArray, i: int, draw: FloatArray, units: FloatArray) -> None:
    """Load a draw (9,) and its units (n, 4) into lane `i`, at rest."""
    c[START + i] = draw[OF_START]
    c[FLUIDITY + i], c[MODULUS + i] = draw[OF_FLUIDITY], draw[OF_MODULUS]
    c[INVERSE + i], c[SIGMA + i] = draw[OF_INVERSE], draw[OF_SIGMA]
    c[GAIN + i], c[ALLOWED + i] = draw[OF_GAIN], draw[OF_ALLOWED]
    c[PIVOT + i] = c[FORCE + i] = c[SCHUR + i] = 0.0
    for n in range(blocks.shape[0]):
        w = blocks[n]
        w[START + i] = draw[OF_START]
        w[FLUIDITY + i], w[MODULUS + i] = units[n, 0], units[n, 1]
        w[INVERSE + i], w[WEIGHT + i] = units[n, 2], units[n, 3]


@njit(**KERNEL_OPTIONS)
def integrate(
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draws: FloatArray,
    units: FloatArray,
    stretch: FloatArray,
    steps: IndexArray,
    ended: FloatArray,
) -> None:
    """Compute the stretch of every draw at `times`, starting at rest.

    Parameters
    ----------
    edges : (S + 1,) ends of the pieces of the excitation [s].
    volts : (S, 6) coefficients of the voltage [V] on a piece, in powers of its elapsed fraction.
    restart : (S,) whether the drive jumps or turns at the start of the piece (1) or not (0).
    times : (N,) ascending, from edges[0] to edges[S].
    draws : (W, 9); see DRAW_COLUMNS.
    units : (W, n, 4): 1/tau, mu, 1/J_beta and the weight of the error of each unit.
    stretch : (W, N) result; a row of NaN if a draw leaves its limits or fails.
    steps : (W,) result: number of steps tried.
    ended : (W,) result: end of the step in which a draw passed its largest stretch, or end of
        the last accepted step of a draw that failed. NaN if a draw reached the last output.
    """
    walkers, pieces, end = draws.shape[0], edges.size - 1, times[times.size - 1]
    most = MOST_STEPS + 4 * pieces
    c = np.full(STRETCH_ROWS * LANES, 1.0)
    blocks = np.full((units.shape[1], UNIT_ROWS * LANES), 1.0)
    lane_draw = np.full(LANES, IDLE)
    piece, output = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    now, proposed = np.zeros(LANES), np.zeros(LANES)
    # This is one function for speed. Smaller functions with the lanes in tuples of arrays were
    # four to seven times slower. A function for the part after an accepted step was 1.4 to 1.6
    # times slower.
    waiting, running = 0, 0
    for i in range(LANES):
        c[PIVOT + i] = c[FORCE + i] = c[SCHUR + i] = c[INVERSE + i] = 0.0
    while True:
        for i in range(LANES):
            while lane_draw[i] == IDLE and waiting < walkers:
                w, waiting = waiting, waiting + 1
                steps[w], ended[w] = 0, np.nan
                if not arrow.usable(draws[w], units[w]):
                    stretch[w], ended[w] = np.nan, edges[0]
                    continue
                _load(c, blocks, i, draws[w], units[w])
                arrow.enter_piece(c, i, SPAN, V0, edges, volts, 0)
                lane_draw[i], piece[i], output[i] = w, 0, 0
                now[i], proposed[i] = edges[0], draws[w, OF_STEP]
                running += 1
            if lane_draw[i] != IDLE:
                begin = edges[piece[i]]
                c[STEP + i] = arrow.fitted_step(proposed[i], edges[piece[i] + 1] - now[i])
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
            lost = steps[w] > most
            if c[ERROR + i] <= 1.0:
                after = edges[piece[i] + 1]
                last = h == after - now[i]
                reached = after if last else now[i] + h
                output[i] = arrow.write_outputs(
                    times, output[i], now[i], h, reached, c[START + i], c[ARGUMENT + i],
                    c[K2 + i], c[K3 + i], c[K4 + i], stretch[w],
                )  # fmt: skip
                c[START + i] = c[ARGUMENT + i]
                for n in range(units.shape[1]):
                    blocks[n, START + i] = blocks[n, ARGUMENT + i]
                now[i] = reached
                proposed[i] = max(h * factor, proposed[i]) if h < proposed[i] else h * factor
                lost |= not c[START + i] <= draws[w, OF_LIMIT]
                if not lost and (output[i] == times.size or reached >= end):
                    lane_draw[i], running = IDLE, running - 1
                elif last and not lost:
                    piece[i] += 1
                    arrow.enter_piece(c, i, SPAN, V0, edges, volts, piece[i])
                    if restart[piece[i]] > 0.0:
                        proposed[i] = min(proposed[i], first)
            else:
                proposed[i] = h * min(factor, 0.8)
                lost |= proposed[i] < arrow.FINEST * first
            if lost and lane_draw[i] != IDLE:
                stretch[w], ended[w] = np.nan, now[i]
                lane_draw[i], running = IDLE, running - 1
