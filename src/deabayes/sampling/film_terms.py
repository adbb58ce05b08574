r"""Three Ogden terms and more, of which records show the film's stress at several stretches.

With v_i the stress of term i at a reference stretch, and psi_k as in `film`,

S_k = sum_i v_i psi_k(alpha_i) / psi_1(alpha_i), k = 1 .. n,

is the film's stress at as many stretches as there are terms, linear in v. Along the sheet of terms
that make the same film all of them stay what they are, so that

u: ln S_1, ln S_{k+1} / S_k, and alpha_1 .. alpha_n

has n flat coordinates, where shares and distances of exponents (`shares`) have two. Of draws of
the structure's posterior with four terms, 0.09 of independence proposals were accepted by those
and 0.46 by these (docs/sampler.md). Not every S has terms of positive stress at given exponents:
there is a wall where one of them vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray


@dataclass(frozen=True)
class FilmTerms:
    """Coordinates of n terms in place of the logarithms of their stresses.

    Attributes
    ----------
    exponents, stresses : columns, in the order of the exponents: of their scores, and of ln v_i.
    middle, sd : of the exponents' prior, from 0 on: alpha = middle + sd score.
    heights : (n,) h_k, falling.
    """

    exponents: tuple[int, ...]
    stresses: tuple[int, ...]
    middle: float
    sd: float
    heights: FloatArray

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; log of the Jacobian, (W,).

        ln |det rho| + sum_i ln v_i - sum_k ln S_k, with rho_ki = psi_k / psi_1 of alpha_i.
        """
        ratios = self._ratios(u)
        log_parts = u[:, list(self.stresses)]
        largest = log_parts.max(axis=1, keepdims=True)
        stresses = np.einsum("wki,wi->wk", ratios, np.exp(log_parts - largest))
        log_stresses = largest + np.log(stresses)
        u[:, self.stresses[0]] = log_stresses[:, 0]
        u[:, list(self.stresses[1:])] = np.diff(log_stresses, axis=1)
        log_determinant = np.linalg.slogdet(ratios)[1]
        return np.asarray(log_determinant + (log_parts - log_stresses).sum(axis=1))

    def bend(self, u: FloatArray) -> None:
        """Undo it; NaN where no terms with such exponents make such stresses."""
        ratios = self._ratios(u)
        log_stresses = np.cumsum(u[:, list(self.stresses)], axis=1)
        log_determinant = np.linalg.slogdet(ratios)[1]
        possible = np.isfinite(log_determinant) & np.isfinite(log_stresses).all(axis=1)
        parts = np.full_like(log_stresses, np.nan)
        largest = log_stresses[possible].max(axis=1, keepdims=True)
        stresses = np.exp(log_stresses[possible] - largest)
        solved = np.linalg.solve(ratios[possible], stresses[..., None])[..., 0]
        parts[possible] = largest + np.log(np.where(solved > 0.0, solved, np.nan))
        u[:, list(self.stresses)] = parts

    def _ratios(self, u: FloatArray) -> FloatArray:
        """rho (W, n, n); NaN where exponents are no positive, rising numbers."""
        exponents = self.middle + self.sd * u[:, list(self.exponents)]
        rising = (exponents[:, 0] > 0.0) & (np.diff(exponents, axis=1) > 0.0).all(axis=1)
        exponents = np.where(rising[:, None], exponents, np.nan)[:, None, :]
        heights, largest = self.heights[:, None], self.heights[0]
        # sinh(h alpha) = e^(h alpha) (1 - e^(-2 h alpha)) / 2
        rest = np.expm1(-2.0 * heights * exponents) / np.expm1(-2.0 * largest * exponents)
        return np.asarray(np.exp((heights - largest) * exponents) * rest)
