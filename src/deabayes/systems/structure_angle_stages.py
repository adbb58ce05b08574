"""Theta and omega in each stage of the minimum-energy structure's step (see `structure_stages`)."""

from __future__ import annotations

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START, U1, U2, U3, U4, U5, U6, U7, U8
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems import structure_kernel as k
from deabayes.systems.structure_kernel import (
    D2,
    D3,
    D4,
    D5,
    D6,
    DAMPING,
    DRIFT,
    ERROR,
    FLOW,
    FORCE,
    K2,
    K3,
    K4,
    PIVOT,
    RATE_OF_STEP,
    SCHUR,
    SLOWNESS,
    SPEED,
    SQUARE,
    STEP,
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
