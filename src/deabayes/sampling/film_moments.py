r"""Three Ogden terms and more of a film handed on: by the moments of their exponents.

With v_i the stress of term i at a reference stretch, w_i its share of their sum S, and
h = (ln lambda_1 - ln lambda_3) / 2, the film's stress at h + delta over that at h is

sum_i w_i (1 + delta y_i + delta^2 alpha_i^2 / 2 + ...), y = alpha coth(h alpha),

so that records fix first the mean of y over the shares (the slope of ln stress), then, nearly, its
variance, its third moment and so on, each less well than the one before. What has these moments in
turn is the Jacobi matrix of y under w,

    a_0  b_1
    b_1  a_1  b_2
         b_2  a_2  ...

the symmetric tridiagonal matrix that has y_i for eigenvalues and w_i^(1/2) for the first components
of eigenvectors: a_0 is the mean, b_1^2 the variance, a_1 makes the third moment, b_2 the fourth.
Any shares above 0 of exponents that differ have one and every b > 0 is of one, so that nothing is
singular where a term vanishes or two exponents meet (b -> 0). The coordinates are

u: ln S, b_k^(2/3), k = 1 .. n - 1, and a_k, k = 0 .. n - 1.

The Jacobian of ln S, ln b_k^2 and a_k by ln v_i and y_i is 1 (Dumitriu & Edelman 2002, J. Math.
Phys. 43, 5830, have the rest of it). The cube root makes a sum of squares nearly normal (Wilson &
Hilferty 1931), where a logarithm would leave a long tail. What else was tried: docs/sampler.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray

POWER = 2.0 / 3.0
"""Of b."""
MOST_STEPS = 20


@dataclass(frozen=True)
class FilmMoments:
    """Coordinates of n terms in place of scores of exponents and logarithms of stresses.

    Attributes
    ----------
    exponents, stresses : columns, in the order of the exponents: of their scores, and of ln v_i.
    middle, sd : of the exponents' prior, from 0 on: alpha = middle + sd score.
    height : h.
    """

    exponents: tuple[int, ...]
    stresses: tuple[int, ...]
    middle: float
    sd: float
    height: float

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; log of the Jacobian, (W,)."""
        exponents = self.middle + self.sd * u[:, list(self.exponents)]
        places, slopes = slope_of(exponents, self.height)
        log_stresses = u[:, list(self.stresses)]
        largest = log_stresses.max(axis=1, keepdims=True)
        total = largest + np.log(np.exp(log_stresses - largest).sum(axis=1, keepdims=True))
        diagonal, beside = jacobi_matrix(places, np.exp(0.5 * (log_stresses - total)))
        u[:, list(self.exponents)] = diagonal
        u[:, self.stresses[0]] = total[:, 0]
        u[:, list(self.stresses[1:])] = beside**POWER
        log_roots = np.log(0.5 * POWER * beside**POWER).sum(axis=1)
        return np.asarray(np.log(self.sd * slopes).sum(axis=1) + log_roots)

    def bend(self, u: FloatArray) -> None:
        """Undo it; NaN where b is not above 0, or a slope is of no exponent above 0."""
        n = len(self.exponents)
        matrix, along = np.zeros((len(u), n, n)), np.arange(n)
        matrix[:, along, along] = u[:, list(self.exponents)]
        roots = u[:, list(self.stresses[1:])]
        beside = np.where(roots > 0.0, roots, np.nan) ** (1.0 / POWER)
        matrix[:, along[1:], along[:-1]] = beside
        lost = ~np.isfinite(matrix).all(axis=(1, 2))
        matrix[lost] = 0.0
        places, vectors = np.linalg.eigh(matrix)  # of the lower half
        places[lost] = np.nan
        total = u[:, [self.stresses[0]]]
        with np.errstate(divide="ignore"):
            u[:, list(self.stresses)] = total + 2.0 * np.log(np.abs(vectors[:, 0, :]))
        u[:, list(self.exponents)] = (exponent_of(places, self.height) - self.middle) / self.sd


def slope_of(exponents: FloatArray, height: float) -> tuple[FloatArray, FloatArray]:
    """alpha coth(h alpha) and its derivative by alpha; NaN where alpha is not above 0."""
    alpha = np.where(exponents > 0.0, exponents, np.nan)
    double = 2.0 * height * alpha
    coth = 1.0 - 2.0 * np.exp(-double) / np.expm1(-double)
    inverse = 2.0 * np.exp(-0.5 * double) / -np.expm1(-double)  # 1 / sinh(h alpha)
    return alpha * coth, coth - height * alpha * inverse**2


def exponent_of(slopes: FloatArray, height: float) -> FloatArray:
    """The alpha above 0 of a slope above 1 / h, by Newton's rule; NaN of others.

    alpha coth(h alpha) is convex in alpha and never above (alpha^2 + h^-2)^(1/2).
    """
    alpha = np.sqrt(np.where(slopes > 0.0, slopes**2 - height**-2, np.nan))
    for _ in range(MOST_STEPS):
        found, change = slope_of(alpha, height)
        step = (found - slopes) / change
        alpha = np.abs(alpha - step)
        if not np.any(np.abs(step) > 1e-14 * alpha):
            break
    return alpha


def jacobi_matrix(places: FloatArray, roots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Diagonal (W, n) and what is beside it (W, n - 1), by Lanczos' recursion.

    Parameters
    ----------
    places : the eigenvalues, (W, n).
    roots : of the shares, first components of the eigenvectors, (W, n).
    """
    vectors, diagonal, beside = [roots], [], []
    for k in range(places.shape[1]):
        diagonal.append((places * vectors[k] ** 2).sum(axis=1))
        if k == places.shape[1] - 1:
            break
        rest = (places - diagonal[k][:, None]) * vectors[k]
        for vector in (*vectors, *vectors):
            rest = rest - (rest * vector).sum(axis=1, keepdims=True) * vector
        beside.append(np.sqrt((rest**2).sum(axis=1)))
        vectors.append(rest / beside[k][:, None])
    return np.stack(diagonal, axis=1), np.stack(beside, axis=1)
