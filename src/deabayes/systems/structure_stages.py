"""The minimum-energy structure's step: Rodas5P's stages for its blocks, in lanes.

The units of a stage come first, because theta's needs the force that they make up (see
`structure_kernel` for the equations and the rows, `integrate.arrow` for the scheme).
"""

from __future__ import annotations

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START, U1, U2, U3, U4, U5, U6, U7, U8
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems import structure_kernel as k
from deabayes.systems.structure_kernel import (
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
def _unit_1(w: FloatArray, c: FloatArray) -> None:
    """Jacobian and first stage of a unit."""
    for i in range(LANES):
        share = c[STEP + i] * w[RATE + i]
        solve = 1.0 / (1.0 / t.GAMMA + share)
        pull = c[LEVER + i] * w[STIFFNESS + i] * solve
        w[SHARE + i], w[SOLVE + i], w[PULL + i] = share, solve, pull
        c[COUPLED + i] += pull * share * c[SLOPE + i]
        _close(w, c, i, w[START + i], 0.0)


@njit(**KERNEL_OPTIONS)
def _unit_2(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U1 + i] = _increment(w, c, i, c[U1 + i])
        _close(w, c, i, arrow.argument_2(w, i), arrow.history_2(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_3(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U2 + i] = _increment(w, c, i, c[U2 + i])
        _close(w, c, i, arrow.argument_3(w, i), arrow.history_3(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_4(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U3 + i] = _increment(w, c, i, c[U3 + i])
        _close(w, c, i, arrow.argument_4(w, i), arrow.history_4(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_5(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U4 + i] = _increment(w, c, i, c[U4 + i])
        _close(w, c, i, arrow.argument_5(w, i), arrow.history_5(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_6(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U5 + i] = _increment(w, c, i, c[U5 + i])
        y = arrow.argument_6(w, i)
        w[ARGUMENT + i] = y
        _close(w, c, i, y, arrow.history_6(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_7(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U6 + i] = _increment(w, c, i, c[U6 + i])
        y = w[ARGUMENT + i] + w[U6 + i]
        w[ARGUMENT + i] = y
        _close(w, c, i, y, arrow.history_7(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_8(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U7 + i] = _increment(w, c, i, c[U7 + i])
        y = w[ARGUMENT + i] + w[U7 + i]
        w[ARGUMENT + i] = y
        _close(w, c, i, y, arrow.history_8(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_end(w: FloatArray, c: FloatArray) -> None:
    """End of the step and its error."""
    for i in range(LANES):
        last = _increment(w, c, i, c[U8 + i])
        w[ARGUMENT + i] += last
        c[ERROR + i] += w[WEIGHT + i] * abs(last)


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
def _angle_1(c: FloatArray, dry: bool) -> None:
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
def _angle_2(c: FloatArray, dry: bool) -> None:
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
def _angle_3(c: FloatArray, dry: bool) -> None:
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
def _angle_4(c: FloatArray, dry: bool) -> None:
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
def _angle_5(c: FloatArray, dry: bool) -> None:
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
def _angle_6(c: FloatArray, dry: bool) -> None:
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
def _angle_7(c: FloatArray, dry: bool) -> None:
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
def _angle_8(c: FloatArray, dry: bool) -> None:
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
def step(c: FloatArray, units: FloatArray, dry: bool) -> None:
    """One step of every lane: the block of theta and omega, those of the `units` (n, ...)."""
    n = units.shape[0]
    k.drive(c)
    k.begin(c)
    for u in range(n):
        _unit_1(units[u], c)
    _angle_1(c, dry)
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
    for u in range(n):
        _unit_end(units[u], c)
    for i in range(LANES):
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = arrow.growth(c[ERROR + i])
