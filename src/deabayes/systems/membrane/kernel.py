"""Compiled Rodas5P integration of the membrane without inertia, for a group of draws at a time."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import (
    ARGUMENT,
    D1,
    DRIFT,
    ERROR,
    FORCE,
    LAST,
    PIVOT,
    SCHUR,
    START,
    STEP,
    U1,
    IndexArray,
)  # fmt: skip
from deabayes.integrate.compiled import literal_unroll, njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, LANES

FLUIDITY, MODULUS, INVERSE, SIGMA, GAIN, HZ = (arrow.FIRST_CONSTANT + r * LANES for r in range(6))
"""Rows of lambda's block: 1/zeta_alpha, mu_alpha, 1/J_alpha, sigma, epsilon/H^2; h/zeta_alpha."""
STRETCH_ROWS = HZ // LANES + 1
OF_FLUIDITY, OF_MODULUS, OF_INVERSE, OF_SIGMA, OF_GAIN = (arrow.OF_CONSTANTS + k for k in range(5))
"""Columns of a draw after those of `arrow.integrate`; y_0 is the stretch."""
RATE, UNIT_MODULUS, UNIT_INVERSE, WEIGHT, UNIT_RATE, FORCE_RATE, SOLVE, COUPLE, PULL, RIGHT = (
    (arrow.SHARED_ROWS + r) * LANES for r in range(10)
)
"""Rows of a unit: 1/tau, mu, 1/J_beta, weight of the error; h/tau, h mu/zeta_alpha, 1/m_k,
h c_k/m_k, h b_k/m_k, r_k/m_k."""
UNIT_ROWS = arrow.SHARED_ROWS + 10
MOST_STEPS = 20_000


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
def _begin(c: FloatArray) -> None:
    """Compute h/zeta_alpha; clear the sums over the units."""
    for i in range(LANES):
        c[HZ + i] = c[STEP + i] * c[FLUIDITY + i]
        c[PIVOT + i], c[FORCE + i], c[SCHUR + i] = 0.0, 0.0, 0.0


@njit(**KERNEL_OPTIONS)
def _unit_begins(w: FloatArray, c: FloatArray) -> None:
    """Compute the Jacobian and the first stage of a unit."""
    for i in range(LANES):
        lam, xi = c[START + i], w[START + i]
        r, by_lam, by_xi = slopes(lam, xi, w[UNIT_INVERSE + i])
        rate, force_rate = c[STEP + i] * w[RATE + i], c[HZ + i] * w[UNIT_MODULUS + i]
        solve = 1.0 / (1.0 / t.GAMMA - rate * lam * by_xi)
        below = rate * (r + lam * by_lam)
        pull = -force_rate * (r + xi * by_xi) * solve
        right = rate * lam * r
        w[UNIT_RATE + i], w[FORCE_RATE + i], w[SOLVE + i] = rate, force_rate, solve
        w[COUPLE + i], w[PULL + i], w[RIGHT + i] = below * solve, pull, right * solve
        c[PIVOT + i] += pull * below - force_rate * xi * by_lam
        c[FORCE + i] += force_rate * xi * r
        c[SCHUR + i] += pull * right


@njit(**KERNEL_OPTIONS)
def _unit_stage(
    w: FloatArray, c: FloatArray, weights: tuple[float, ...], history: tuple[float, ...]
) -> None:
    """Compute a unit's increment of the stage before, and its right-hand side in this stage.

    `weights` and `history` are the rows of A and C for this stage.
    """
    stage = len(weights) + 1
    before = U1 + (stage - 2) * LANES
    for i in range(LANES):
        w[before + i] = w[RIGHT + i] + w[COUPLE + i] * c[before + i]
        if stage > arrow.FIRST_AT_THE_END:
            xi = w[ARGUMENT + i] + w[before + i]
        else:
            xi = arrow.combined(w, i, w[START + i], weights)
        if stage >= arrow.FIRST_AT_THE_END:
            w[ARGUMENT + i] = xi
        lam = c[ARGUMENT + i]
        r = resistance(lam, xi, w[UNIT_INVERSE + i])
        right = w[UNIT_RATE + i] * lam * r + arrow.combined(w, i, 0.0, history)
        w[RIGHT + i] = right * w[SOLVE + i]
        c[FORCE + i] += w[FORCE_RATE + i] * xi * r
        c[SCHUR + i] += w[PULL + i] * right


@njit(**KERNEL_OPTIONS)
def _unit_ends(w: FloatArray, c: FloatArray) -> None:
    """Compute a unit's value at the end of the step and its error."""
    for i in range(LANES):
        increment = w[RIGHT + i] + w[COUPLE + i] * c[LAST + i]
        w[ARGUMENT + i] += increment
        c[ERROR + i] += w[WEIGHT + i] * abs(increment)


@njit(**KERNEL_OPTIONS)
def _stretch_begins(c: FloatArray) -> None:
    """Compute the pivot and the first stage of lambda; clear the sums over the units."""
    for i in range(LANES):
        lam, hz = c[START + i], c[HZ + i]
        r, by_lam, _ = slopes(lam, 1.0, c[INVERSE + i])
        square, drive = lam * lam, c[GAIN + i] * c[D1 + i]
        diagonal = hz * (3.0 * drive * square - c[MODULUS + i] * by_lam)
        solve = 1.0 / (1.0 / t.GAMMA - diagonal - c[PIVOT + i])
        flow = hz * (drive * square * lam + c[SIGMA + i] - c[MODULUS + i] * r)
        c[DRIFT + i] *= hz * c[GAIN + i] * square * lam
        u = solve * (flow - c[FORCE + i] + c[SCHUR + i] + t.D[0] * c[DRIFT + i])
        c[PIVOT + i], c[U1 + i], c[FORCE + i], c[SCHUR + i] = solve, u, 0.0, 0.0
        c[ARGUMENT + i] = arrow.combined(c, i, c[START + i], t.A[1])


@njit(**KERNEL_OPTIONS)
def _stretch_stage(
    c: FloatArray, history: tuple[float, ...], following: tuple[float, ...], of_drift: float
) -> None:
    """Compute the increment of lambda in this stage, and the argument of the next stage.

    `history` and `following` are the rows of C for this stage and of A for the next.
    """
    stage = len(history) + 1
    here, node = U1 + (stage - 1) * LANES, D1 + min(stage - 1, arrow.DIFFERENT_NODES - 1) * LANES
    for i in range(LANES):
        lam = c[ARGUMENT + i]
        r = resistance(lam, 1.0, c[INVERSE + i])
        pull = c[GAIN + i] * c[node + i] * lam * lam * lam
        flow = c[HZ + i] * (pull + c[SIGMA + i] - c[MODULUS + i] * r)
        earlier = arrow.combined(c, i, of_drift * c[DRIFT + i], history)
        c[here + i] = c[PIVOT + i] * (flow - c[FORCE + i] + c[SCHUR + i] + earlier)
        c[FORCE + i], c[SCHUR + i] = 0.0, 0.0
        if stage >= arrow.FIRST_AT_THE_END:
            c[ARGUMENT + i] += c[here + i]
        else:
            c[ARGUMENT + i] = arrow.combined(c, i, c[START + i], following)


@njit(**KERNEL_OPTIONS)
def step(c: FloatArray, units: FloatArray) -> None:
    """Make one step in every lane: lambda's block `c` and the blocks of the `units` (n, ...)."""
    arrow.drive(c)
    _begin(c)
    for u in range(units.shape[0]):
        _unit_begins(units[u], c)
    _stretch_begins(c)
    for stage in literal_unroll(arrow.STAGES):
        weights, history, following, of_drift = stage
        for u in range(units.shape[0]):
            _unit_stage(units[u], c, weights, history)
        _stretch_stage(c, history, following, of_drift)
    for i in range(LANES):
        c[ERROR + i] = abs(c[LAST + i])
    for u in range(units.shape[0]):
        _unit_ends(units[u], c)
    arrow.finish(c)


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
    """Compute the stretch (W, N) of every draw, starting at rest; see `arrow.integrate`.

    Parameters
    ----------
    draws : (W, 10), see `arrow.OF_START` and OF_FLUIDITY.
    units : (W, n, 5): stretch at the start, 1/tau, mu, 1/J_beta, weight of the error.
    """
    arrow.integrate(
        step, 0, np.ones(STRETCH_ROWS * LANES), np.ones((units.shape[1], UNIT_ROWS * LANES)),
        edges, volts, restart, times, draws, units, MOST_STEPS + 4 * restart.size,
        stretch, steps, ended,
    )  # fmt: skip
