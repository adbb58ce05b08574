"""A unit in each stage of the minimum-energy structure's step (see `structure_stages`)."""

from __future__ import annotations

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START, U1, U2, U3, U4, U5, U6, U7, U8
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems.structure_kernel import (
    COUPLED,
    ERROR,
    FORCE,
    LATE,
    LEVER,
    PLACE,
    PULL,
    RATE,
    SCHUR,
    SHARE,
    SLOPE,
    SOLVE,
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
