"""Rodas5P integration of the minimum-energy structure, for a group of draws (lanes) at a time."""

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
from deabayes.systems.minimum_energy_structure import kernel as k
from deabayes.systems.minimum_energy_structure.kernel import (
    ALLOWED,
    COUPLED,
    D1,
    DAMPING,
    DRIFT,
    ERROR,
    FACTOR,
    FLOW,
    FORCE,
    K2,
    K3,
    K4,
    LATE,
    LEVER,
    PIVOT,
    PLACE,
    PULL,
    RATE,
    RATE_OF_STEP,
    SCHUR,
    SHARE,
    SLOPE,
    SLOWNESS,
    SOLVE,
    SPEED,
    SQUARE,
    STEP,
    STIFFNESS,
    WEIGHT,
)

IndexArray = NDArray[np.int64]
UnitStage = Callable[[FloatArray, FloatArray], None]
AngleStage = Callable[[FloatArray, bool], None]


@njit(**KERNEL_OPTIONS)
def _increments(c: FloatArray, i: int, row: int, of_speed: float, of_angle: float) -> None:
    """Compute the increments of theta and omega in a stage; clear the sums over the units."""
    right = c[STEP + i] * of_speed + c[DAMPING + i] * of_angle + c[SCHUR + i]
    c[FORCE + i], c[SCHUR + i] = 0.0, 0.0
    u = c[PIVOT + i] * right
    c[row + i], c[SPEED + row + i] = u, c[RATE_OF_STEP + i] * (u / t.GAMMA - of_angle)


@njit(**KERNEL_OPTIONS)
def _move(c: FloatArray, i: int, weights: tuple[float, ...]) -> None:
    """Set the argument of the next stage for theta and omega."""
    c[ARGUMENT + i] = arrow.combined(c, i, c[START + i], weights)
    c[SPEED + ARGUMENT + i] = arrow.combined(c, SPEED + i, c[SPEED + START + i], weights)


@njit(**KERNEL_OPTIONS)
def _angle_begins(c: FloatArray, dry: bool) -> None:
    """Compute the first stage of theta and omega."""
    k.accelerate(c, dry)
    k.jacobian(c)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + START + i]
        _increments(c, i, U1, c[FLOW + i] + t.D1 * c[DRIFT + i], of_angle)
        _move(c, i, t.A[1])
        c[SQUARE + i] = c[D1 + LANES + i]
    k.place(c)


def _angle_stage(stage: int) -> AngleStage:
    """Return a function for theta and omega: increments of this stage, argument of the next."""
    row, node = U1 + (stage - 1) * LANES, D1 + min(stage, k.DIFFERENT_NODES - 1) * LANES
    history, of_drift, weights = t.C[stage - 1], t.D[stage - 1], t.A[stage]
    at_the_end = stage >= arrow.FIRST_AT_THE_END

    @njit(**KERNEL_OPTIONS)
    def angle_stage(c: FloatArray, dry: bool) -> None:
        k.accelerate(c, dry)
        for i in range(LANES):
            moved = c[STEP + i] * c[SPEED + ARGUMENT + i]
            of_angle = arrow.combined(c, i, moved, history)
            flow = c[FLOW + i]
            if not at_the_end:
                flow += of_drift * c[DRIFT + i]
            _increments(c, i, row, arrow.combined(c, SPEED + i, flow, history), of_angle)
            if at_the_end:
                c[ARGUMENT + i] += c[row + i]
                c[SPEED + ARGUMENT + i] += c[SPEED + row + i]
            else:
                _move(c, i, weights)
                c[SQUARE + i] = c[node + i]
        k.place(c)

    return angle_stage


@njit(**KERNEL_OPTIONS)
def _angle_ends(c: FloatArray, dry: bool) -> None:
    """Compute the error of theta and omega, and the dense output."""
    last = U1 + (t.STAGES - 1) * LANES
    for i in range(LANES):
        c[ERROR + i] = abs(c[last + i]) + c[SLOWNESS + i] * abs(c[SPEED + last + i])
        c[K2 + i] = arrow.combined(c, i, 0.0, t.H2)
        c[K3 + i] = arrow.combined(c, i, 0.0, t.H3)
        c[K4 + i] = arrow.combined(c, i, 0.0, t.H4)
    if dry:
        k.doubt(c)


@njit(**KERNEL_OPTIONS)
def _respond(w: FloatArray, c: FloatArray, i: int, y: float, history: float) -> None:
    """Compute a unit's right-hand side in a stage, and add its terms to the sums over units."""
    late = history - w[SHARE + i] * (y + c[PLACE + i])
    w[LATE + i] = late
    c[FORCE + i] += w[STIFFNESS + i] * y
    c[SCHUR + i] += w[PULL + i] * late


@njit(**KERNEL_OPTIONS)
def _unit_begins(w: FloatArray, c: FloatArray) -> None:
    """Compute the Jacobian and the first stage of a unit."""
    for i in range(LANES):
        share = c[STEP + i] * w[RATE + i]
        solve = 1.0 / (1.0 / t.GAMMA + share)
        pull = c[LEVER + i] * w[STIFFNESS + i] * solve
        w[SHARE + i], w[SOLVE + i], w[PULL + i] = share, solve, pull
        c[COUPLED + i] += pull * share * c[SLOPE + i]
        _respond(w, c, i, w[START + i], 0.0)


def _unit_stage(stage: int) -> UnitStage:
    """Return a function for a unit: increment of the stage before, right-hand side of this one."""
    before, weights, history = U1 + (stage - 2) * LANES, t.A[stage - 1], t.C[stage - 1]
    kept, added = stage >= arrow.FIRST_AT_THE_END, stage > arrow.FIRST_AT_THE_END

    @njit(**KERNEL_OPTIONS)
    def unit_stage(w: FloatArray, c: FloatArray) -> None:
        for i in range(LANES):
            of_angle = w[SHARE + i] * c[SLOPE + i] * c[before + i]
            w[before + i] = w[SOLVE + i] * (w[LATE + i] + of_angle)
            if added:
                y = w[ARGUMENT + i] + w[before + i]
            else:
                y = arrow.combined(w, i, w[START + i], weights)
            if kept:
                w[ARGUMENT + i] = y
            _respond(w, c, i, y, arrow.combined(w, i, 0.0, history))

    return unit_stage


@njit(**KERNEL_OPTIONS)
def _unit_ends(w: FloatArray, c: FloatArray) -> None:
    """Compute a unit's value at the end of the step and its error."""
    last = U1 + (t.STAGES - 1) * LANES
    for i in range(LANES):
        of_angle = w[SHARE + i] * c[SLOPE + i] * c[last + i]
        increment = w[SOLVE + i] * (w[LATE + i] + of_angle)
        w[ARGUMENT + i] += increment
        c[ERROR + i] += w[WEIGHT + i] * abs(increment)


_unit_2, _unit_3, _unit_4, _unit_5, _unit_6, _unit_7, _unit_8 = map(_unit_stage, range(2, 9))
_angle_2, _angle_3, _angle_4, _angle_5, _angle_6, _angle_7, _angle_8 = map(
    _angle_stage, range(2, 9)
)


@njit(**KERNEL_OPTIONS)
def step(c: FloatArray, units: FloatArray, dry: bool) -> None:
    """Make one step in every lane: block `c` of theta and omega, and blocks `units` (n, ...)."""
    n = units.shape[0]
    k.drive(c)
    k.begin(c)
    for u in range(n):
        _unit_begins(units[u], c)
    _angle_begins(c, dry)
    for u in range(n):
        _unit_2(units[u], c)
    _angle_2(c, dry)
    for u in range(n):
        _unit_3(units[u], c)
    _angle_3(c, dry)
    for u in range(n):
        _unit_4(units[u], c)
    _angle_4(c, dry)
    for u in range(n):
        _unit_5(units[u], c)
    _angle_5(c, dry)
    for u in range(n):
        _unit_6(units[u], c)
    _angle_6(c, dry)
    for u in range(n):
        _unit_7(units[u], c)
    _angle_7(c, dry)
    for u in range(n):
        _unit_8(units[u], c)
    _angle_8(c, dry)
    _angle_ends(c, dry)
    for u in range(n):
        _unit_ends(units[u], c)
    for i in range(LANES):
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = arrow.growth(c[ERROR + i])


OF_START, OF_STEP, OF_LOW, OF_HIGH, OF_CONSTANTS = range(5)
"""Columns of a draw: starting angle, first step after a jump of the voltage, the lowest and the
highest allowed angle, then the constants in the order of the kernel's rows."""
CONSTANTS = 17
OF_DRY = OF_CONSTANTS + (k.DRY - k.INERTIA) // LANES
DRAW_COLUMNS = OF_CONSTANTS + CONSTANTS + k.FILM_DEGREE + 1
IDLE = -1
MOST_STEPS = 200_000
"""Largest number of steps. An oscillation at 60 Hz for 50 s needs 100 000 steps."""


@njit(**KERNEL_OPTIONS)
def _load(c: FloatArray, blocks: FloatArray, i: int, draw: FloatArray, units: FloatArray) -> None:
    """Load a draw and its units (n, 4) into lane `i`, with zero speed."""
    c[START + i], c[k.SPEED + START + i] = draw[OF_START], 0.0
    for row in range(CONSTANTS):
        c[k.INERTIA + row * LANES + i] = draw[OF_CONSTANTS + row]
    for power in range(k.FILM_DEGREE + 1):
        c[k.S0 + power * LANES + i] = draw[OF_CONSTANTS + CONSTANTS + power]
    for n in range(blocks.shape[0]):
        w = blocks[n]
        w[k.RATE + i], w[k.STIFFNESS + i] = units[n, 0], units[n, 1]
        w[k.WEIGHT + i], w[START + i] = units[n, 2], units[n, 3]


@njit(**KERNEL_OPTIONS)
def displacement(angle: FloatArray, length: FloatArray, rest: FloatArray) -> FloatArray:
    """Displacement (W, N) of the slider at angles (W, N), faster than with numpy's cosine."""
    found = np.empty_like(angle)
    for w in range(angle.shape[0]):
        at_rest = k.sine_cosine(rest[w])[1]
        for n in range(angle.shape[1]):
            found[w, n] = 2.0 * length[w] * (k.sine_cosine(angle[w, n])[1] - at_rest)
    return found


@njit(**KERNEL_OPTIONS)
def integrate(
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draws: FloatArray,
    units: FloatArray,
    most_steps: int,
    angle: FloatArray,
    steps: IndexArray,
    ended: FloatArray,
) -> None:
    """Compute the angle of every draw at `times`, starting with zero speed.

    Parameters
    ----------
    edges : (S + 1,) ends of the pieces of the excitation [s].
    volts : (S, 6) coefficients of the voltage [V] on a piece, in powers of its elapsed fraction.
    restart : (S,) whether the drive jumps or turns at the start of the piece (1) or not (0).
    times : (N,) ascending, from edges[0] to edges[S].
    draws : (W, DRAW_COLUMNS).
    units : (W, n, 4): 1/tau, k, weight of the error and y at the start of each unit.
    most_steps : largest number of steps of a draw; a draw that needs more has failed.
    angle : (W, N) result; a row of NaN if a draw leaves its limits or fails.
    steps : (W,) result: number of steps tried.
    ended : (W,) result: time when a draw left its limits or failed, else NaN.
    """
    walkers, end = draws.shape[0], times[times.size - 1]
    c = np.full(k.ANGLE_ROWS * LANES, 0.5)
    blocks = np.full((units.shape[1], k.UNIT_ROWS * LANES), 0.0)
    lane_draw = np.full(LANES, IDLE)
    piece, output = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    now, proposed = np.zeros(LANES), np.zeros(LANES)
    # This is one function for speed. Smaller functions with the lanes in tuples of arrays were
    # four to seven times slower. A function for the part after an accepted step was 1.4 to 1.6
    # times slower.
    waiting, running = 0, 0
    dry = np.any(draws[:, OF_DRY] > 0.0)
    while True:
        for i in range(LANES):
            while lane_draw[i] == IDLE and waiting < walkers:
                w, waiting = waiting, waiting + 1
                steps[w], ended[w] = 0, np.nan
                if not arrow.usable(draws[w], units[w]):
                    angle[w], ended[w] = np.nan, edges[0]
                    continue
                _load(c, blocks, i, draws[w], units[w])
                arrow.enter_piece(c, i, k.SPAN, k.V0, edges, volts, 0)
                lane_draw[i], piece[i], output[i] = w, 0, 0
                now[i], proposed[i] = edges[0], draws[w, OF_STEP]
                running += 1
            if lane_draw[i] != IDLE:
                begin = edges[piece[i]]
                c[k.STEP + i] = arrow.fitted_step(proposed[i], edges[piece[i] + 1] - now[i])
                c[k.OFFSET + i] = (now[i] - begin) * c[k.SPAN + i]
        if running == 0:
            break
        step(c, blocks, dry)
        for i in range(LANES):
            w = lane_draw[i]
            if w == IDLE:
                continue
            steps[w] += 1
            h, factor, first = c[k.STEP + i], c[k.FACTOR + i], draws[w, OF_STEP]
            lost = steps[w] > most_steps
            if c[k.ERROR + i] <= 1.0:
                after = edges[piece[i] + 1]
                last = h == after - now[i]
                reached = after if last else now[i] + h
                output[i] = arrow.write_outputs(
                    times, output[i], now[i], h, reached, c[START + i], c[ARGUMENT + i],
                    c[k.K2 + i], c[k.K3 + i], c[k.K4 + i], angle[w],
                )  # fmt: skip
                c[START + i], c[k.SPEED + START + i] = c[ARGUMENT + i], c[k.SPEED + ARGUMENT + i]
                for n in range(units.shape[1]):
                    blocks[n, START + i] = blocks[n, ARGUMENT + i]
                now[i] = reached
                proposed[i] = max(h * factor, proposed[i]) if h < proposed[i] else h * factor
                lost |= not draws[w, OF_LOW] <= c[START + i] <= draws[w, OF_HIGH]
                if not lost and (output[i] == times.size or reached >= end):
                    lane_draw[i], running = IDLE, running - 1
                elif last and not lost:
                    piece[i] += 1
                    arrow.enter_piece(c, i, k.SPAN, k.V0, edges, volts, piece[i])
                    if restart[piece[i]] > 0.0:
                        proposed[i] = min(proposed[i], first)
            else:
                proposed[i] = h * min(factor, 0.8)
                lost |= proposed[i] < arrow.FINEST * first
            if lost and lane_draw[i] != IDLE:
                angle[w], ended[w] = np.nan, now[i]
                lane_draw[i], running = IDLE, running - 1
