"""The step of the minimum-energy structure: the stages of Rodas5P in lanes of draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START, U1, U2, U3, U4, U5, U6, U7, U8
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS
from deabayes.systems.minimum_energy_structure import kernel as k
from deabayes.systems.minimum_energy_structure.kernel import (
    ALLOWED,
    COUPLED,
    D2,
    D3,
    D4,
    D5,
    D6,
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


@njit(**KERNEL_OPTIONS)
def _solve(c: FloatArray, i: int, of_speed: float, of_angle: float) -> float:
    """Theta's increment from the right-hand sides of both; clears the sums over the units."""
    right = c[STEP + i] * of_speed + c[DAMPING + i] * of_angle + c[SCHUR + i]
    c[FORCE + i], c[SCHUR + i] = 0.0, 0.0
    return c[PIVOT + i] * right


@njit(**KERNEL_OPTIONS)
def _speed(c: FloatArray, i: int, increment: float, of_angle: float) -> float:
    """Omega's increment from theta's."""
    return c[RATE_OF_STEP + i] * (increment / t.GAMMA - of_angle)


@njit(**KERNEL_OPTIONS)
def angle_1(c: FloatArray, dry: bool) -> None:
    """First stage of theta and omega."""
    k.accelerate(c, dry)
    k.jacobian(c)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + START + i]
        u = _solve(c, i, c[FLOW + i] + t.D1 * c[DRIFT + i], of_angle)
        c[U1 + i], c[SPEED + U1 + i] = u, _speed(c, i, u, of_angle)
        c[ARGUMENT + i] = arrow.argument_2(c, i)
        c[SPEED + ARGUMENT + i] = arrow.argument_2(c, SPEED + i)
        c[SQUARE + i] = c[D2 + i]
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_2(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_2(c, i)
        of_speed = c[FLOW + i] + arrow.history_2(c, SPEED + i) + t.D2 * c[DRIFT + i]
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U2 + i], c[SPEED + U2 + i] = u, a
        c[ARGUMENT + i] = arrow.argument_3(c, i)
        c[SPEED + ARGUMENT + i] = arrow.argument_3(c, SPEED + i)
        c[SQUARE + i] = c[D3 + i]
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_3(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_3(c, i)
        of_speed = c[FLOW + i] + arrow.history_3(c, SPEED + i) + t.D3 * c[DRIFT + i]
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U3 + i], c[SPEED + U3 + i] = u, a
        c[ARGUMENT + i] = arrow.argument_4(c, i)
        c[SPEED + ARGUMENT + i] = arrow.argument_4(c, SPEED + i)
        c[SQUARE + i] = c[D4 + i]
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_4(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_4(c, i)
        of_speed = c[FLOW + i] + arrow.history_4(c, SPEED + i) + t.D4 * c[DRIFT + i]
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U4 + i], c[SPEED + U4 + i] = u, a
        c[ARGUMENT + i] = arrow.argument_5(c, i)
        c[SPEED + ARGUMENT + i] = arrow.argument_5(c, SPEED + i)
        c[SQUARE + i] = c[D5 + i]
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_5(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_5(c, i)
        of_speed = c[FLOW + i] + arrow.history_5(c, SPEED + i) + t.D5 * c[DRIFT + i]
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U5 + i], c[SPEED + U5 + i] = u, a
        c[ARGUMENT + i] = arrow.argument_6(c, i)
        c[SPEED + ARGUMENT + i] = arrow.argument_6(c, SPEED + i)
        c[SQUARE + i] = c[D6 + i]
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_6(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_6(c, i)
        of_speed = c[FLOW + i] + arrow.history_6(c, SPEED + i)
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U6 + i], c[SPEED + U6 + i] = u, a
        c[ARGUMENT + i] += u
        c[SPEED + ARGUMENT + i] += a
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_7(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_7(c, i)
        of_speed = c[FLOW + i] + arrow.history_7(c, SPEED + i)
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U7 + i], c[SPEED + U7 + i] = u, a
        c[ARGUMENT + i] += u
        c[SPEED + ARGUMENT + i] += a
    k.place(c)


@njit(**KERNEL_OPTIONS)
def angle_8(c: FloatArray, dry: bool) -> None:
    k.accelerate(c, dry)
    for i in range(LANES):
        of_angle = c[STEP + i] * c[SPEED + ARGUMENT + i] + arrow.history_8(c, i)
        of_speed = c[FLOW + i] + arrow.history_8(c, SPEED + i)
        u = _solve(c, i, of_speed, of_angle)
        a = _speed(c, i, u, of_angle)
        c[U8 + i], c[SPEED + U8 + i] = u, a
        c[ARGUMENT + i] += u
        c[SPEED + ARGUMENT + i] += a
        c[ERROR + i] = abs(u) + c[SLOWNESS + i] * abs(a)
        c[K2 + i], c[K3 + i] = arrow.dense_2(c, i), arrow.dense_3(c, i)
        c[K4 + i] = arrow.dense_4(c, i)
    if dry:
        k.doubt(c)


@njit(**KERNEL_OPTIONS)
def _close(w: FloatArray, c: FloatArray, i: int, y: float, history: float) -> None:
    """The part of a unit's stage that all stages share."""
    late = history - w[SHARE + i] * (y + c[PLACE + i])
    w[LATE + i] = late
    c[FORCE + i] += w[STIFFNESS + i] * y
    c[SCHUR + i] += w[PULL + i] * late


@njit(**KERNEL_OPTIONS)
def _increment(w: FloatArray, c: FloatArray, i: int, of_angle: float) -> float:
    """A unit's increment in a stage from that of theta."""
    return w[SOLVE + i] * (w[LATE + i] + w[SHARE + i] * c[SLOPE + i] * of_angle)


@njit(**KERNEL_OPTIONS)
def unit_1(w: FloatArray, c: FloatArray) -> None:
    """Jacobian and first stage of a unit."""
    for i in range(LANES):
        share = c[STEP + i] * w[RATE + i]
        solve = 1.0 / (1.0 / t.GAMMA + share)
        pull = c[LEVER + i] * w[STIFFNESS + i] * solve
        w[SHARE + i], w[SOLVE + i], w[PULL + i] = share, solve, pull
        c[COUPLED + i] += pull * share * c[SLOPE + i]
        _close(w, c, i, w[START + i], 0.0)


@njit(**KERNEL_OPTIONS)
def unit_2(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U1 + i] = _increment(w, c, i, c[U1 + i])
        _close(w, c, i, arrow.argument_2(w, i), arrow.history_2(w, i))


@njit(**KERNEL_OPTIONS)
def unit_3(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U2 + i] = _increment(w, c, i, c[U2 + i])
        _close(w, c, i, arrow.argument_3(w, i), arrow.history_3(w, i))


@njit(**KERNEL_OPTIONS)
def unit_4(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U3 + i] = _increment(w, c, i, c[U3 + i])
        _close(w, c, i, arrow.argument_4(w, i), arrow.history_4(w, i))


@njit(**KERNEL_OPTIONS)
def unit_5(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U4 + i] = _increment(w, c, i, c[U4 + i])
        _close(w, c, i, arrow.argument_5(w, i), arrow.history_5(w, i))


@njit(**KERNEL_OPTIONS)
def unit_6(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U5 + i] = _increment(w, c, i, c[U5 + i])
        y = arrow.argument_6(w, i)
        w[ARGUMENT + i] = y
        _close(w, c, i, y, arrow.history_6(w, i))


@njit(**KERNEL_OPTIONS)
def unit_7(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U6 + i] = _increment(w, c, i, c[U6 + i])
        y = w[ARGUMENT + i] + w[U6 + i]
        w[ARGUMENT + i] = y
        _close(w, c, i, y, arrow.history_7(w, i))


@njit(**KERNEL_OPTIONS)
def unit_8(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U7 + i] = _increment(w, c, i, c[U7 + i])
        y = w[ARGUMENT + i] + w[U7 + i]
        w[ARGUMENT + i] = y
        _close(w, c, i, y, arrow.history_8(w, i))


@njit(**KERNEL_OPTIONS)
def unit_end(w: FloatArray, c: FloatArray) -> None:
    """End of the step and its error."""
    for i in range(LANES):
        last = _increment(w, c, i, c[U8 + i])
        w[ARGUMENT + i] += last
        c[ERROR + i] += w[WEIGHT + i] * abs(last)


@njit(**KERNEL_OPTIONS)
def step(c: FloatArray, units: FloatArray, dry: bool) -> None:
    """One step of every lane: the block of theta and omega, those of the `units` (n, ...)."""
    n = units.shape[0]
    k.drive(c)
    k.begin(c)
    for u in range(n):
        unit_1(units[u], c)
    angle_1(c, dry)
    for u in range(n):
        unit_2(units[u], c)
    angle_2(c, dry)
    for u in range(n):
        unit_3(units[u], c)
    angle_3(c, dry)
    for u in range(n):
        unit_4(units[u], c)
    angle_4(c, dry)
    for u in range(n):
        unit_5(units[u], c)
    angle_5(c, dry)
    for u in range(n):
        unit_6(units[u], c)
    angle_6(c, dry)
    for u in range(n):
        unit_7(units[u], c)
    angle_7(c, dry)
    for u in range(n):
        unit_8(units[u], c)
    angle_8(c, dry)
    for u in range(n):
        unit_end(units[u], c)
    for i in range(LANES):
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = arrow.growth(c[ERROR + i])


IndexArray = NDArray[np.int64]
OF_START, OF_STEP, OF_LOW, OF_HIGH, OF_CONSTANTS = range(5)
"""Columns of a draw: starting angle, first step after a jump of the voltage, the angles
between which it stays, and from there on the constants in the order of the kernel's rows."""
CONSTANTS = 17
OF_DRY = OF_CONSTANTS + (k.DRY - k.INERTIA) // LANES
DRAW_COLUMNS = OF_CONSTANTS + CONSTANTS + k.FILM_DEGREE + 1
UNIT_COLUMNS = 4
"""Columns of a unit: 1/tau, k, weight of its error, y at the start."""
IDLE = -1
MOST_STEPS = 200_000
"""A structure that rings at 60 Hz for 50 s takes 100 000."""


@njit(**KERNEL_OPTIONS)
def _load(c: FloatArray, blocks: FloatArray, i: int, draw: FloatArray, units: FloatArray) -> None:
    """Put a draw with its units (n, 4) into lane `i`, at rest."""
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
    """Displacement (W, N) of the slider at angles (W, N): numpy's cosine took a quarter of all."""
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
    """Angle of every draw at `times`, starting without speed.

    Parameters
    ----------
    edges : (S + 1,) ends of the pieces of the excitation [s].
    volts : (S, 6) voltage on a piece [V], powers of the fraction of it that has passed.
    restart : (S,) whether the drive jumps or turns at the start of the piece (1) or not (0).
    times : (N,) ascending, from edges[0] to edges[S].
    draws : (W, DRAW_COLUMNS), units : (W, n, 4).
    most_steps : of a draw, which is lost where it needs more.
    angle : (W, N) result; a row of NaN where a draw leaves its limits or fails.
    steps : (W,) result: steps tried.
    ended : (W,) result: when a draw left its limits or failed; NaN for one that did not.
    """
    walkers, end = draws.shape[0], times[times.size - 1]
    c = np.full(k.ANGLE_ROWS * LANES, 0.5)
    blocks = np.full((units.shape[1], k.UNIT_ROWS * LANES), 0.0)
    lane_draw = np.full(LANES, IDLE)
    piece, output = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    now, proposed = np.zeros(LANES), np.zeros(LANES)
    # One function: lanes kept in tuples of arrays for parts of it went four to seven times slower,
    # and a call for what follows a good step 1.4 to 1.6 times slower.
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
