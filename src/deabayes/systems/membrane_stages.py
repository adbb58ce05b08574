"""The membrane's step: Rodas5P's stages for its blocks, in lanes.

The units of a stage come first, because lambda's needs the force that they make up (see
`membrane_kernel` for the equations and the rows, `integrate.arrow` for the scheme).
"""

from __future__ import annotations

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START, U1, U2, U3, U4, U5, U6, U7, U8
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems import membrane_kernel as k
from deabayes.systems.membrane_kernel import (
    ALLOWED,
    COUPLE,
    D1,
    D2,
    D3,
    D4,
    D5,
    D6,
    DRIFT,
    ERROR,
    FACTOR,
    FLUIDITY,
    FORCE,
    FORCE_RATE,
    HZ,
    INVERSE,
    K2,
    K3,
    K4,
    MODULUS,
    PIVOT,
    PULL,
    RATE,
    RIGHT,
    SCHUR,
    SIGMA,
    SOLVE,
    STEP,
    WEIGHT,
)


@njit(**KERNEL_OPTIONS)
def _unit_1(w: FloatArray, c: FloatArray) -> None:
    """Jacobian and first stage of a unit."""
    for i in range(LANES):
        lam, xi = c[START + i], w[START + i]
        r, by_lam, by_xi = k.slopes(lam, xi, w[INVERSE + i])
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


@njit(**KERNEL_OPTIONS)
def _close(w: FloatArray, c: FloatArray, i: int, lam: float, xi: float, history: float) -> None:
    """The part of a unit's stage that all stages share."""
    r = k.resistance(lam, xi, w[INVERSE + i])
    right = w[RATE + i] * lam * r + history
    w[RIGHT + i] = right * w[SOLVE + i]
    c[FORCE + i] += w[FORCE_RATE + i] * xi * r
    c[SCHUR + i] += w[PULL + i] * right


@njit(**KERNEL_OPTIONS)
def _unit_2(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U1 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U1 + i]
        _close(w, c, i, c[ARGUMENT + i], arrow.argument_2(w, i), arrow.history_2(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_3(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U2 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U2 + i]
        _close(w, c, i, c[ARGUMENT + i], arrow.argument_3(w, i), arrow.history_3(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_4(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U3 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U3 + i]
        _close(w, c, i, c[ARGUMENT + i], arrow.argument_4(w, i), arrow.history_4(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_5(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U4 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U4 + i]
        _close(w, c, i, c[ARGUMENT + i], arrow.argument_5(w, i), arrow.history_5(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_6(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U5 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U5 + i]
        xi = arrow.argument_6(w, i)
        w[ARGUMENT + i] = xi
        _close(w, c, i, c[ARGUMENT + i], xi, arrow.history_6(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_7(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U6 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U6 + i]
        xi = w[ARGUMENT + i] + w[U6 + i]
        w[ARGUMENT + i] = xi
        _close(w, c, i, c[ARGUMENT + i], xi, arrow.history_7(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_8(w: FloatArray, c: FloatArray) -> None:
    for i in range(LANES):
        w[U7 + i] = w[RIGHT + i] + w[COUPLE + i] * c[U7 + i]
        xi = w[ARGUMENT + i] + w[U7 + i]
        w[ARGUMENT + i] = xi
        _close(w, c, i, c[ARGUMENT + i], xi, arrow.history_8(w, i))


@njit(**KERNEL_OPTIONS)
def _unit_end(w: FloatArray, c: FloatArray) -> None:
    """End of the step and its error."""
    for i in range(LANES):
        last = w[RIGHT + i] + w[COUPLE + i] * c[U8 + i]
        w[ARGUMENT + i] += last
        c[ERROR + i] += w[WEIGHT + i] * abs(last)


@njit(**KERNEL_OPTIONS)
def _stretch_1(c: FloatArray) -> None:
    """Pivot and first stage of lambda; clears the sums over the units."""
    for i in range(LANES):
        lam, hz = c[START + i], c[HZ + i]
        r, by_lam, _ = k.slopes(lam, 1.0, c[INVERSE + i])
        square = lam * lam
        diagonal = hz * (3.0 * c[D1 + i] * square - c[MODULUS + i] * by_lam)
        solve = 1.0 / (1.0 / t.GAMMA - diagonal - c[PIVOT + i])
        flow = hz * (c[D1 + i] * square * lam + c[SIGMA + i] - c[MODULUS + i] * r)
        c[DRIFT + i] *= square * lam
        u = solve * (flow - c[FORCE + i] + c[SCHUR + i] + t.D1 * c[DRIFT + i])
        c[PIVOT + i], c[U1 + i], c[FORCE + i], c[SCHUR + i] = solve, u, 0.0, 0.0
        c[ARGUMENT + i] = arrow.argument_2(c, i)


@njit(**KERNEL_OPTIONS)
def _solve(c: FloatArray, i: int, drive: float, history: float) -> float:
    """The increment of lambda in a stage; clears the sums over the units."""
    lam = c[ARGUMENT + i]
    r = k.resistance(lam, 1.0, c[INVERSE + i])
    flow = c[HZ + i] * (drive * lam * lam * lam + c[SIGMA + i] - c[MODULUS + i] * r)
    u = c[PIVOT + i] * (flow - c[FORCE + i] + c[SCHUR + i] + history)
    c[FORCE + i], c[SCHUR + i] = 0.0, 0.0
    return u


@njit(**KERNEL_OPTIONS)
def _stretch_2(c: FloatArray) -> None:
    for i in range(LANES):
        c[U2 + i] = _solve(c, i, c[D2 + i], arrow.history_2(c, i) + t.D2 * c[DRIFT + i])
        c[ARGUMENT + i] = arrow.argument_3(c, i)


@njit(**KERNEL_OPTIONS)
def _stretch_3(c: FloatArray) -> None:
    for i in range(LANES):
        c[U3 + i] = _solve(c, i, c[D3 + i], arrow.history_3(c, i) + t.D3 * c[DRIFT + i])
        c[ARGUMENT + i] = arrow.argument_4(c, i)


@njit(**KERNEL_OPTIONS)
def _stretch_4(c: FloatArray) -> None:
    for i in range(LANES):
        c[U4 + i] = _solve(c, i, c[D4 + i], arrow.history_4(c, i) + t.D4 * c[DRIFT + i])
        c[ARGUMENT + i] = arrow.argument_5(c, i)


@njit(**KERNEL_OPTIONS)
def _stretch_5(c: FloatArray) -> None:
    for i in range(LANES):
        c[U5 + i] = _solve(c, i, c[D5 + i], arrow.history_5(c, i) + t.D5 * c[DRIFT + i])
        c[ARGUMENT + i] = arrow.argument_6(c, i)


@njit(**KERNEL_OPTIONS)
def _stretch_6(c: FloatArray) -> None:
    for i in range(LANES):
        c[U6 + i] = _solve(c, i, c[D6 + i], arrow.history_6(c, i))
        c[ARGUMENT + i] += c[U6 + i]


@njit(**KERNEL_OPTIONS)
def _stretch_7(c: FloatArray) -> None:
    for i in range(LANES):
        c[U7 + i] = _solve(c, i, c[D6 + i], arrow.history_7(c, i))
        c[ARGUMENT + i] += c[U7 + i]


@njit(**KERNEL_OPTIONS)
def _stretch_8(c: FloatArray) -> None:
    for i in range(LANES):
        c[U8 + i] = _solve(c, i, c[D6 + i], arrow.history_8(c, i))
        c[ARGUMENT + i] += c[U8 + i]
        c[ERROR + i] = abs(c[U8 + i])
        c[PIVOT + i] = 0.0
        c[K2 + i], c[K3 + i] = arrow.dense_2(c, i), arrow.dense_3(c, i)
        c[K4 + i] = arrow.dense_4(c, i)


@njit(**KERNEL_OPTIONS)
def _control(c: FloatArray) -> None:
    """Error over what is allowed, and the factor to the next step."""
    for i in range(LANES):
        c[ERROR + i] *= c[ALLOWED + i]
        c[FACTOR + i] = arrow.growth(c[ERROR + i])


@njit(**KERNEL_OPTIONS)
def step(c: FloatArray, units: FloatArray) -> None:
    """One step of every lane: lambda's block `c` and the blocks of the `units` (n, ...)."""
    n = units.shape[0]
    k.drive(c)
    for u in range(n):
        _unit_1(units[u], c)
    _stretch_1(c)
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
    for u in range(n):
        _unit_end(units[u], c)
    _control(c)
