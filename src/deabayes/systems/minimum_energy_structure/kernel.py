r"""Compiled kernel of the minimum-energy structure: slider-crank, film and Maxwell units.

See equations.md, section 3, and (11)-(23) of the paper. With s = sin theta, c = cos theta,
omega = theta', the slider's displacement d = 2L (c - c_0), and y_i = x_i - d, so that the
equation of a unit does not contain omega:

    theta' = omega,    M omega' = Q,    y_i' = -(y_i + d)/tau_i,    M = M_0 + C s^2
    Q = (s/c) S(c) - G c - H theta - E s c U^2 - C s c omega^2
        + 2L s (sum_i k_i (y_i + d) - eta_0 v - F_c v/sqrt(v^2 + v_s^2)),   v = 2L s omega

M_0 = 2J + 2 m_1 l_m^2, C = 4L (m_1 (L - l_m) + m_2 L), G = 2 m_1 g l_m, H = 4K, E = A_0
epsilon_0 epsilon_r/t_0. S = A_0 t_0 sigma_x at zero voltage is P/B. P is a polynomial in c, with
its own coefficients for every draw. B is the argument 1 - (I_1 - 3)/J of a Gent spring, because a
polynomial cannot follow the pole; B is 1 for other springs. U is a polynomial in time on each
piece of the excitation. theta is the quantity y_0 of `integrate.arrow`, which couples to all
others; omega is eliminated.
"""

from __future__ import annotations

import math

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import ARGUMENT, LANES, START
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS

DEGREE = 5
"""Degree of the voltage as a polynomial in time on a piece."""
DIFFERENT_NODES = 6
"""Number of different nodes in the tableau: stages 6 to 8 are at the end of the step."""
FILM_DEGREE = 14
"""Degree of P in cos theta. With the Ogden exponents of the paper, its relative error is 3e-10
from 3 to 70 degrees. `motion.followed` finds the steepest angle for which it is accurate."""
DRY_SPEED = 5e-4
"""v_s [m/s]: speed below which dry friction is smoothed; strokes have 1 to 300 mm/s."""
KINK = 0.03
"""Share of the largest change of omega by dry friction that `doubt` adds to a step's error."""
(
    INERTIA, TURNING, ELECTRIC, HINGE, GRAVITY, LENGTH, REST, VISCOUS, DRY, UNITS, SLOWNESS,
    MIDDLE, SCALE, ALLOWED, ROOM, TAKEN, LEAST,
    STEP, RATE_OF_STEP, D1, D2, D3, D4, D5, D6, DRIFT, SQUARE, FLOW,
    SINE, COSINE, PLACE, FORCE, SCHUR, COUPLED, SLOPE, LEVER, DAMPING, PIVOT,
    ERROR, FACTOR, K2, K3, K4, OFFSET, SPAN,
) = ((arrow.SHARED_ROWS + r) * LANES for r in range(45))  # fmt: skip
"""Rows of theta's block: constants of the draw, among them 2L, c_0, the sum of k_i, the weight of
omega's error and the terms of B c^2 = c^2 (ROOM - TAKEN c^2) - LEAST; step, 1/step, squared
voltage at the nodes; s, c, d at the argument; sums over the units; constants of the Jacobian of a
step; step control; dense output; position in the piece of the excitation, 1/its duration."""
V0 = (arrow.SHARED_ROWS + 45) * LANES
S0, S1, S2, S3, S4, S5, S6, S7, S8, S9, S10, S11, S12, S13, S14 = (
    V0 + (DEGREE + 1 + power) * LANES for power in range(FILM_DEGREE + 1)
)
"""Coefficients of U on the piece, and of P, in ascending powers."""
SPEED = (arrow.SHARED_ROWS + 45 + DEGREE + 1 + FILM_DEGREE + 1) * LANES
"""Start of omega's block. It is in the same array, because otherwise loops are not vectorised."""
ANGLE_ROWS = SPEED // LANES + arrow.SHARED_ROWS
RATE, STIFFNESS, WEIGHT, SHARE, SOLVE, PULL, LATE = (
    (arrow.SHARED_ROWS + r) * LANES for r in range(7)
)
"""Rows of a unit: 1/tau, k, weight of its error; h/tau, 1/m_k, h^2 b_k/m_k, right-hand side."""
UNIT_ROWS = arrow.SHARED_ROWS + 7
_HALF = math.sqrt(0.5)
_C2, _S3, _C4, _S5, _C6, _S7, _C8, _S9, _C10, _S11, _C12 = (
    (-1.0) ** (n // 2) / math.factorial(n) for n in range(2, 13)
)
"""Coefficients of the series of cosine and sine, as factors: a division costs ten products."""


@njit(**KERNEL_OPTIONS)
def sine_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine by their series about 45 degrees; error 1e-11 from 2 to 85 degrees."""
    x = angle - 0.25 * math.pi
    q = x * x
    odd = x * (1.0 + q * (_S3 + q * (_S5 + q * (_S7 + q * (_S9 + q * _S11)))))
    even = 1.0 + q * (_C2 + q * (_C4 + q * (_C6 + q * (_C8 + q * (_C10 + q * _C12)))))
    return _HALF * (even + odd), _HALF * (even - odd)


@njit(**KERNEL_OPTIONS)
def place(c: FloatArray) -> None:
    """Compute s, c and d at the argument."""
    for i in range(LANES):
        sine, cosine = sine_cosine(c[ARGUMENT + i])
        c[SINE + i], c[COSINE + i] = sine, cosine
        c[PLACE + i] = c[LENGTH + i] * (cosine - c[REST + i])


@njit(**KERNEL_OPTIONS)
def _film(c: FloatArray, i: int, z: float) -> float:
    """Return P [N] at z = (cos theta - middle) scale; written without a loop, to vectorise."""
    found = c[S14 + i]
    found = c[S12 + i] + z * (c[S13 + i] + z * found)
    found = c[S10 + i] + z * (c[S11 + i] + z * found)
    found = c[S8 + i] + z * (c[S9 + i] + z * found)
    found = c[S6 + i] + z * (c[S7 + i] + z * found)
    found = c[S4 + i] + z * (c[S5 + i] + z * found)
    found = c[S2 + i] + z * (c[S3 + i] + z * found)
    return c[S0 + i] + z * (c[S1 + i] + z * found)


@njit(**KERNEL_OPTIONS)
def _stiffening(c: FloatArray, i: int, square: float) -> float:
    """Return 1/B at cos^2 theta; NaN past the Gent limit."""
    b = square * (c[ROOM + i] - c[TAKEN + i] * square) - c[LEAST + i]
    return square / b if b > 0.0 else np.nan


@njit(**KERNEL_OPTIONS)
def _film_slope(c: FloatArray, i: int, z: float) -> float:
    """Return dP/dz [N]."""
    found = 13.0 * c[S13 + i] + z * 14.0 * c[S14 + i]
    found = 11.0 * c[S11 + i] + z * (12.0 * c[S12 + i] + z * found)
    found = 9.0 * c[S9 + i] + z * (10.0 * c[S10 + i] + z * found)
    found = 7.0 * c[S7 + i] + z * (8.0 * c[S8 + i] + z * found)
    found = 5.0 * c[S5 + i] + z * (6.0 * c[S6 + i] + z * found)
    found = 3.0 * c[S3 + i] + z * (4.0 * c[S4 + i] + z * found)
    return c[S1 + i] + z * (2.0 * c[S2 + i] + z * found)


@njit(**KERNEL_OPTIONS)
def _rub(c: FloatArray) -> None:
    """Subtract dry friction from the force on the slider."""
    for i in range(LANES):
        v = c[LENGTH + i] * c[SINE + i] * c[SPEED + ARGUMENT + i]
        c[FORCE + i] -= c[DRY + i] * v / np.sqrt(v * v + DRY_SPEED * DRY_SPEED)


@njit(**KERNEL_OPTIONS)
def accelerate(c: FloatArray, dry: bool) -> None:
    """Compute h Q/M at the argument from the rows of s, c, d, U^2 and the sum of k_i y_i."""
    if dry:
        _rub(c)
    for i in range(LANES):
        sine, cosine, length = c[SINE + i], c[COSINE + i], c[LENGTH + i]
        omega = c[SPEED + ARGUMENT + i]
        v = length * sine * omega
        slider = c[FORCE + i] + c[UNITS + i] * c[PLACE + i] - c[VISCOUS + i] * v
        moment = length * sine * slider - c[GRAVITY + i] * cosine - c[HINGE + i] * c[ARGUMENT + i]
        around = c[ELECTRIC + i] * c[SQUARE + i] + c[TURNING + i] * omega * omega
        moment -= sine * cosine * around
        inverse = c[STEP + i] / (cosine * (c[INERTIA + i] + c[TURNING + i] * sine * sine))
        z = (cosine - c[MIDDLE + i]) * c[SCALE + i]
        film = _film(c, i, z) * _stiffening(c, i, cosine * cosine)
        c[FLOW + i] = inverse * (sine * film + cosine * moment)


@njit(**KERNEL_OPTIONS)
def drive(c: FloatArray) -> None:
    """Compute the squared voltage at the nodes, and h times its slope at the start."""
    for i in range(LANES):
        x, dx = c[OFFSET + i], c[STEP + i] * c[SPAN + i]
        v0, v1, v2 = c[V0 + i], c[V0 + LANES + i], c[V0 + 2 * LANES + i]
        v3, v4, v5 = c[V0 + 3 * LANES + i], c[V0 + 4 * LANES + i], c[V0 + 5 * LANES + i]
        v = v0 + x * (v1 + x * (v2 + x * (v3 + x * (v4 + x * v5))))
        slope = v1 + x * (2.0 * v2 + x * (3.0 * v3 + x * (4.0 * v4 + x * 5.0 * v5)))
        c[DRIFT + i] = 2.0 * v * slope * dx
        for node in range(DIFFERENT_NODES):
            a = x + t.NODES[node] * dx
            v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
            c[D1 + node * LANES + i] = v * v


@njit(**KERNEL_OPTIONS)
def begin(c: FloatArray) -> None:
    """Compute the lever h^2 2L s/M of the units at the start; clear the sums over the units."""
    for i in range(LANES):
        c[ARGUMENT + i], c[SPEED + ARGUMENT + i] = c[START + i], c[SPEED + START + i]
        c[SQUARE + i] = c[D1 + i]
    place(c)
    for i in range(LANES):
        h, sine = c[STEP + i], c[SINE + i]
        mass = c[INERTIA + i] + c[TURNING + i] * sine * sine
        c[RATE_OF_STEP + i] = 1.0 / h
        c[SLOPE + i] = c[LENGTH + i] * sine
        c[LEVER + i] = h * h * c[SLOPE + i] / mass
        c[FORCE + i], c[SCHUR + i], c[COUPLED + i] = 0.0, 0.0, 0.0


@njit(**KERNEL_OPTIONS)
def jacobian(c: FloatArray) -> None:
    """Compute the pivots and the drift of a step; call `accelerate` at its start before."""
    for i in range(LANES):
        h, omega = c[STEP + i], c[SPEED + START + i]
        sine, cosine, slope = c[SINE + i], c[COSINE + i], c[SLOPE + i]
        speed = slope * omega
        smooth = 1.0 / (speed * speed + DRY_SPEED * DRY_SPEED)
        root = np.sqrt(smooth)
        resisting = c[VISCOUS + i] + c[DRY + i] * DRY_SPEED * DRY_SPEED * smooth * root
        slider = c[FORCE + i] + c[UNITS + i] * c[PLACE + i] - c[VISCOUS + i] * speed
        around = c[ELECTRIC + i] * c[D1 + i] + c[TURNING + i] * omega * omega
        z = (cosine - c[MIDDLE + i]) * c[SCALE + i]
        square = cosine * cosine
        stiffer = _stiffening(c, i, square)
        film = _film(c, i, z) * stiffer
        steeper = _film_slope(c, i, z) * c[SCALE + i] * stiffer
        closer = c[TAKEN + i] * cosine - c[LEAST + i] / (square * cosine)
        steeper += 2.0 * film * stiffer * closer
        inverse = 1.0 / (c[INERTIA + i] + c[TURNING + i] * sine * sine)
        turning = 2.0 * c[TURNING + i] * sine * cosine
        stiffness = film / square - sine * sine / cosine * steeper
        stiffness += c[GRAVITY + i] * sine - c[HINGE + i]
        stiffness -= (cosine * cosine - sine * sine) * around
        stiffness += c[LENGTH + i] * cosine * (slider - slope * omega * resisting)
        stiffness -= slope * slope * c[UNITS + i]
        by_speed = -inverse * (turning * omega + slope * slope * resisting)
        damping = 1.0 / t.GAMMA - h * by_speed
        by_angle = h * inverse * (h * stiffness - turning * c[FLOW + i])
        c[DAMPING + i] = damping
        c[PIVOT + i] = 1.0 / (damping / t.GAMMA - by_angle - c[COUPLED + i])
        c[DRIFT + i] *= -h * inverse * c[ELECTRIC + i] * sine * cosine


@njit(**KERNEL_OPTIONS)
def doubt(c: FloatArray) -> None:
    """Add to a step's error an estimate of the error that dry friction causes.

    Friction has a kink if the speed changes by more than its smallest value in the step and by
    more than v_s. Then the method and its embedded formula can agree by chance, which gives an
    error estimate that is too small.
    """
    for i in range(LANES):
        before = c[SLOPE + i] * c[SPEED + START + i]
        after = c[LENGTH + i] * c[SINE + i] * c[SPEED + ARGUMENT + i]
        slowest = min(abs(before), abs(after)) if before * after > 0.0 else 0.0
        change = after - before
        bend = change * change / (slowest * slowest + DRY_SPEED * DRY_SPEED)
        bend *= bend * bend
        most = c[DRY + i] * c[LEVER + i] * c[RATE_OF_STEP + i]
        c[ERROR + i] += KINK * c[SLOWNESS + i] * most * bend / (1.0 + bend)
