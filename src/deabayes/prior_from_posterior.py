"""A posterior as the prior of another study: a normal in the default prior's coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from deabayes.faults import UserError
from deabayes.normal_scores import FloatArray

FEWEST_DRAWS_PER_PARAMETER = 10
LARGEST_MISFIT = 0.05
"""Distance of distribution functions from which draws are no longer called normal."""


class PriorFromPosterior(NamedTuple):
    """Draws of another posterior, to be used as a prior."""

    names: tuple[str, ...]
    draws: FloatArray
    """(S, k), SI."""

    def __repr__(self) -> str:
        return f"<Prior from {len(self.draws)} draws of {', '.join(self.names)}>"


@dataclass(frozen=True)
class PosteriorBlock:
    """A multivariate normal in the default prior's standard-normal coordinate.

    z_default = mean + cholesky z. `misfit` is the largest Kolmogorov-Smirnov
    distance between the whitened draws' marginals and N(0, 1): 0 for a posterior
    that is normal in z.
    """

    names: tuple[str, ...]
    mean: FloatArray
    cholesky: FloatArray
    misfit: float

    @classmethod
    def fit(cls, names: tuple[str, ...], z: FloatArray) -> PosteriorBlock:
        """Fit to draws z (S, k) in the default coordinate.

        Raises
        ------
        UserError : too few draws, or draws without spread.
        """
        size, dimension = z.shape
        if size < FEWEST_DRAWS_PER_PARAMETER * dimension:
            raise UserError(
                f"prior_from: {size} draws cannot carry the correlations of {dimension} "
                f"parameters; give at least {FEWEST_DRAWS_PER_PARAMETER * dimension}"
            )
        mean = z.mean(axis=0)
        covariance = np.atleast_2d(np.cov(z, rowvar=False))
        try:
            cholesky = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise UserError(
                "prior_from: the draws do not vary in every direction of "
                f"{', '.join(names)}; is one of them fixed?"
            ) from None
        block = cls(names, mean, cholesky, 0.0)
        return replace(block, misfit=largest_ks_distance(block.whiten(z)))

    def of(self, names: Sequence[str]) -> PosteriorBlock | None:
        """The marginal normal of those of its parameters that are named; None if none is."""
        kept = [k for k, name in enumerate(self.names) if name in names]
        if not kept:
            return None
        covariance = (self.cholesky @ self.cholesky.T)[np.ix_(kept, kept)]
        cholesky = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return replace(
            self,
            names=tuple(self.names[k] for k in kept),
            mean=self.mean[kept],
            cholesky=cholesky,
        )

    def colour(self, z: FloatArray) -> FloatArray:
        """Default coordinate (W, k) of the standard normal z (W, k)."""
        return self.mean + z @ self.cholesky.T

    def whiten(self, z_default: FloatArray) -> FloatArray:
        """Inverse of `colour`."""
        return (z_default - self.mean) @ np.linalg.inv(self.cholesky).T

    def log_density_ratio(self, z_default: FloatArray) -> FloatArray:
        """log N(z_default; mean, covariance) - log N(z_default; 0, I), (W,)."""
        z = self.whiten(z_default)
        log_determinant = np.sum(np.log(np.diag(self.cholesky)))
        return 0.5 * np.sum(z_default**2 - z**2, axis=1) - log_determinant


def largest_ks_distance(z: FloatArray) -> float:
    """Largest distance of a column's empirical distribution (S, k) from N(0, 1)."""
    from scipy.special import ndtr

    size = z.shape[0]
    uniform = ndtr(np.sort(z, axis=0))
    above = np.arange(1, size + 1)[:, None] / size - uniform
    return float(np.max(np.maximum(above, 1.0 / size - above)))
