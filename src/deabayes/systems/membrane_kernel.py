r"""Compiled kernel of the membrane: KV-GM under a voltage, equal-biaxial, inertia-free.

equations.md, section 2; Nguyen et al. 2021, (12)-(13). With l = lambda^2, x = xi^2,
q = 1/J (q = 0: no limit) and B = x l^2 (1 + 3 q) - q (2 l^3 + x^3), which is the Gent
argument times x l^2:

    R(lambda, xi) = (l^3 - x^3)/(lambda xi B),   nominal stress of a unit P = mu xi R
    xi' = (1/tau) lambda R
    lambda' = (1/zeta_alpha) (d lambda^3 + sigma - mu_alpha R(lambda, 1) - sum_i P_i)

with d = epsilon (Phi/H)^2 and Phi a polynomial in time on each piece of the excitation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate import rodas5p as t
from deabayes.integrate.arrow import LANES
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray

IndexArray = NDArray[np.int64]
FLUIDITY, MODULUS, INVERSE, WEIGHT = ((arrow.SHARED_ROWS + r) * LANES for r in range(4))
"""Rows of every block: 1/tau or 1/zeta_alpha, mu, 1/J, weight of the error."""
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
and its h^2-fold slope; sums over the units; control; dense output; place in the piece of
the excitation, 1/its duration, its coefficients."""
STRETCH_ROWS = arrow.SHARED_ROWS + 32
DEGREE = 5
"""Of the voltage in time on a piece."""


@njit(**KERNEL_OPTIONS)
def resistance(lam: float, xi: float, q: float) -> float:
    """R(lambda, xi); NaN outside the Gent limit."""
    square, x = lam * lam, xi * xi
    cube, xcube = square * square * square, x * x * x
    b = x * square * square * (1.0 + 3.0 * q) - q * (2.0 * cube + xcube)
    below = lam * xi * b
    return (cube - xcube) / below if (b > 0.0) & (below > 0.0) else np.nan


@njit(**KERNEL_OPTIONS)
def slopes(lam: float, xi: float, q: float) -> tuple[float, float, float]:
    """R and its derivatives by lambda and by xi."""
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
    """Step over zeta_alpha, and the drive at the nodes."""
    for i in range(LANES):
        h = c[STEP + i]
        c[HZ + i] = h * c[FLUIDITY + i]
        x, dx = c[OFFSET + i], h * c[SPAN + i]
        v0, v1, v2, v3 = c[V0 + i], c[V1 + i], c[V2 + i], c[V3 + i]
        v4, v5, gain = c[V4 + i], c[V5 + i], c[GAIN + i]
        v = v0 + x * (v1 + x * (v2 + x * (v3 + x * (v4 + x * v5))))
        slope = v1 + x * (2.0 * v2 + x * (3.0 * v3 + x * (4.0 * v4 + x * 5.0 * v5)))
        c[D1 + i] = gain * v * v
        c[DRIFT + i] = c[HZ + i] * 2.0 * gain * v * slope * dx
        a = x + t.NODE2 * dx
        v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
        c[D2 + i] = gain * v * v
        a = x + t.NODE3 * dx
        v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
        c[D3 + i] = gain * v * v
        a = x + t.NODE4 * dx
        v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
        c[D4 + i] = gain * v * v
        a = x + t.NODE5 * dx
        v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
        c[D5 + i] = gain * v * v
        a = x + dx
        v = v0 + a * (v1 + a * (v2 + a * (v3 + a * (v4 + a * v5))))
        c[D6 + i] = gain * v * v
