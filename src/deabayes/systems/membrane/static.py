r"""Equilibria of the membrane on the near branch, and the end of this branch.

At rest the Maxwell units carry no stress. With the nominal stress p(lambda) = P_alpha/mu_alpha of
the Gent spring, the pre-stretch lambda_p and the drive d = epsilon (Phi/H)^2, equilibria satisfy
d/mu_alpha = g(lambda) = (p(lambda) - p(lambda_p))/lambda^3. The near branch starts at lambda_p and
ends at the first maximum of g. This is a fold, where pull-in happens. With a small J there is no
fold.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS

LOCK_UP = 0.995
"""Largest stretch of a branch over the stretch at the Gent limit."""


@njit(**KERNEL_OPTIONS)
def _spring(lam: float, q: float) -> tuple[float, float]:
    """Return p and dp/dlambda of an equal-biaxial Gent spring with 1/J = q."""
    square = lam * lam
    fourth = 1.0 / (square * square)
    argument = 1.0 - q * (2.0 * square + fourth - 3.0)
    force = lam - fourth / lam
    slope = 1.0 + 5.0 * fourth / square
    return force / argument, slope / argument + 4.0 * q * force * force / (argument * argument)


@njit(**KERNEL_OPTIONS)
def _reserve(lam: float, q: float, prestress: float) -> float:
    """Return lambda^4 dg/dlambda, which is positive if the equilibrium is stable."""
    p, slope = _spring(lam, q)
    return lam * slope - 3.0 * (p - prestress)


@njit(**KERNEL_OPTIONS)
def _end_of_branch(
    prestretch: float, q: float, breakdown: float, points: int
) -> tuple[float, bool]:
    """Return the stretch at the end of the near branch, and whether the end is a fold."""
    top = breakdown
    if q > 0.0:
        lock_up = np.sqrt(0.5 * (1.0 / q + 3.0))
        if not lock_up * LOCK_UP > prestretch:
            return np.nan, False
        top = min(top, lock_up * LOCK_UP)
    if not top > prestretch:
        return np.nan, False
    prestress, _ = _spring(prestretch, q)
    lower = prestretch
    for k in range(1, points + 1):
        upper = prestretch + (top - prestretch) * k / points
        if _reserve(upper, q, prestress) < 0.0:
            for _ in range(50):
                middle = 0.5 * (lower + upper)
                if _reserve(middle, q, prestress) < 0.0:
                    upper = middle
                else:
                    lower = middle
                if upper - lower < 1e-12 * upper:
                    break
            return lower, True
        lower = upper
    return top, False


@njit(**KERNEL_OPTIONS)
def end_of_branch(
    prestretch: FloatArray, inverse_limit: FloatArray, breakdown: float, points: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return stretch and d/mu_alpha at the end of the near branch, and 1 for a fold, each (W,).

    Parameters
    ----------
    prestretch, inverse_limit : (W,) lambda_p and 1/J_alpha.
    breakdown : largest stretch of the branch.
    points : number of points of the search for the fold. An unstable region that is narrower than
        their spacing may be missed.
    """
    stretch, drive = np.empty(prestretch.size), np.empty(prestretch.size)
    fold = np.zeros(prestretch.size)
    for w in range(prestretch.size):
        end, folded = _end_of_branch(prestretch[w], inverse_limit[w], breakdown, points)
        prestress, _ = _spring(prestretch[w], inverse_limit[w])
        p, _ = _spring(end, inverse_limit[w])
        stretch[w], drive[w] = end, (p - prestress) / (end * end * end)
        fold[w] = 1.0 if folded else 0.0
    return stretch, drive, fold


@njit(**KERNEL_OPTIONS)
def near_equilibrium(
    prestretch: FloatArray, inverse_limit: FloatArray, end: FloatArray, drive: FloatArray
) -> FloatArray:
    """Stretch (W,) of the near branch at d/mu_alpha = `drive`; NaN beyond its `end`."""
    found = np.full(prestretch.size, np.nan)
    for w in range(prestretch.size):
        q = inverse_limit[w]
        prestress, _ = _spring(prestretch[w], q)
        lower, upper = prestretch[w], end[w]
        p, _ = _spring(upper, q)
        if not p - prestress >= drive[w] * upper * upper * upper:
            continue
        for _ in range(60):
            middle = 0.5 * (lower + upper)
            p, _ = _spring(middle, q)
            if p - prestress < drive[w] * middle * middle * middle:
                lower = middle
            else:
                upper = middle
        found[w] = 0.5 * (lower + upper)
    return found
