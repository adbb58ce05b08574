"""One smooth piece of a voltage history: a polynomial through neighbouring knots."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from deabayes.experiment import FloatArray

DEGREE = 5
LARGEST_SCATTER = 5.0
"""Knots may lie this many times their scatter about a smooth curve from the polynomial."""
LONGEST_GAP = 4.0
"""Times the mean distance of the knots: a polynomial is bound to nothing in a longer gap."""
EVEN = 1e-9
"""Knots this close to even spacing, over their span, share one basis."""
_CHEBYSHEV_POWERS = np.zeros((DEGREE + 1, DEGREE + 1))
for _n in range(DEGREE + 1):
    _shifted = np.polynomial.Chebyshev.basis(_n, domain=[0.0, 1.0])
    _CHEBYSHEV_POWERS[: _n + 1, _n] = _shifted.convert(
        kind=np.polynomial.Polynomial, domain=[-1.0, 1.0], window=[-1.0, 1.0]
    ).coef


def line(start: float, end: float) -> FloatArray:
    return np.array([start, end - start, 0.0, 0.0, 0.0, 0.0])


def fitted(
    knots: FloatArray, volts: FloatArray, begin: int, count: int, allowed: tuple[float, float]
) -> FloatArray | None:
    """Least-squares polynomial over `count` intervals, or None if it misses knots.

    Parameters
    ----------
    allowed : misfit of a knot, and the scatter that comes on top.
    """
    time, values = knots[begin : begin + count + 1], volts[begin : begin + count + 1]
    if np.ptp(values) == 0.0:
        return line(float(values[0]), float(values[0]))
    x = (time - time[0]) / (time[-1] - time[0])
    if np.max(np.abs(x - np.arange(count + 1) / count)) < EVEN:
        basis, to_powers = _even_basis(count)
    elif np.max(np.diff(x)) > LONGEST_GAP / count:
        return None
    else:
        basis, to_powers = _basis(x)
    weights = basis.T @ values
    misfit, noise = np.abs(basis @ weights - values), allowed[1]
    if np.max(misfit) > allowed[0] + LARGEST_SCATTER * noise:
        return None
    # More than noise would leave is a shape the polynomial misses (chi-square, 2 sd).
    more = 1.0 + 2.0 * np.sqrt(2.0 / misfit.size)
    if np.mean(misfit**2) > allowed[0] ** 2 + more * noise**2:
        return None
    return np.asarray(to_powers @ weights)


def _basis(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal polynomials at `x` (M,) within [0, 1], (M, 6), and the powers they are of."""
    chebyshev = np.polynomial.chebyshev.chebvander(2.0 * x - 1.0, DEGREE)
    basis, triangle = np.linalg.qr(chebyshev)
    return basis, _CHEBYSHEV_POWERS @ np.linalg.inv(triangle)


@lru_cache(maxsize=256)
def _even_basis(count: int) -> tuple[FloatArray, FloatArray]:
    return _basis(np.arange(count + 1) / count)
