"""A mixture of multivariate normals, and the transform to a standard normal vector."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.scores import log_normal_density


@dataclass(frozen=True)
class NormalMixture:
    r"""x with density sum_j w_j N(x; m_j, L_j L_j^T).

    Its Knothe-Rosenblatt transform z ~ N(0, I) is z_i = Phi^-1(F(x_i | x_1 ... x_{i-1})), where the
    conditional distribution F is a mixture of univariate normals,

        F = sum_j W_j Phi(e_ji),  e_j = L_j^-1 (x - m_j),  W_j ~ w_j prod_{l < i} phi(e_jl) / L_jll.

    For one component x = m + L z. For several, all places in a gap between two components have
    almost the same z, so nothing is sampled there.

    Parameters
    ----------
    weights : (K,), summing to one.
    means : (K, k).
    factors : (K, k, k), lower Cholesky factors of the covariances.
    """

    weights: FloatArray
    means: FloatArray
    factors: FloatArray

    @property
    def components(self) -> int:
        return int(self.weights.size)

    @cached_property
    def _scales(self) -> FloatArray:
        """L_jii, (K, k)."""
        return np.diagonal(self.factors, axis1=1, axis2=2)

    def marginal(self, columns: Sequence[int]) -> NormalMixture:
        """Marginal mixture of some of the coordinates, in the given order."""
        covariances = self.factors @ self.factors.transpose(0, 2, 1)
        kept = covariances[:, columns][:, :, columns]
        factors = np.asarray(np.linalg.cholesky(kept), dtype=np.float64)
        return NormalMixture(self.weights, self.means[:, columns], factors)

    def as_one(self) -> NormalMixture:
        """Single normal with the mean and covariance of the mixture."""
        mean = self.weights @ self.means
        spread = np.sqrt(self.weights)[:, None] * (self.means - mean)
        within = np.einsum("j,jab,jcb->ac", self.weights, self.factors, self.factors)
        factor = np.asarray(np.linalg.cholesky(within + spread.T @ spread), dtype=np.float64)
        return NormalMixture(np.ones(1), mean[None], factor[None])

    def sample(self, rng: np.random.Generator, n: int) -> FloatArray:
        """n draws (n, k)."""
        chosen = rng.choice(self.components, size=n, p=self.weights)
        normal = rng.standard_normal((n, self.means.shape[1]))
        return self.means[chosen] + np.einsum("sab,sb->sa", self.factors[chosen], normal)

    def log_density(self, x: FloatArray) -> FloatArray:
        """log p(x), (W,), of x (W, k)."""
        from scipy.special import logsumexp

        if self.components == 1:
            density = log_normal_density(self._whiten_one(x)).sum(axis=1)
            return np.asarray(density - np.log(self._scales[0]).sum())
        log_weights = np.tile(np.log(self.weights), (len(x), 1))
        for e, column in self._standardised(x):
            log_weights += log_normal_density(e) - np.log(self._scales[:, column])
        return np.asarray(logsumexp(log_weights, axis=1))

    def whiten(self, x: FloatArray) -> FloatArray:
        """z (W, k) of x (W, k)."""
        if self.components == 1:
            return self._whiten_one(x)
        z = np.empty_like(x, dtype=float)
        log_weights = np.tile(np.log(self.weights), (len(x), 1))
        for e, column in self._standardised(x):
            z[:, column] = _score(log_weights, e)
            log_weights = log_weights + log_normal_density(e) - np.log(self._scales[:, column])
        return z

    def _whiten_one(self, x: FloatArray) -> FloatArray:
        """L^-1 (x - m) of a single component, 70 times faster than conditional scores."""
        from scipy.linalg import solve_triangular

        away = (x - self.means[0]).T
        z = solve_triangular(self.factors[0], away, lower=True, check_finite=False)
        return np.asarray(z.T)

    def colour(self, z: FloatArray) -> FloatArray:
        """x (W, k) of z (W, k), for mixtures of one component only."""
        assert self.components == 1
        return np.asarray(self.means[0] + z @ self.factors[0].T)

    def _standardised(self, x: FloatArray) -> Iterator[tuple[FloatArray, int]]:
        """Yield e_ji (W, K) and the column index i, column by column."""
        e = np.zeros((*x.shape, self.components))
        for column in range(x.shape[1]):
            e[:, column] = x[:, column, None] - self._centres(e, column)
            e[:, column] /= self._scales[:, column]
            yield e[:, column], column

    def _centres(self, e: FloatArray, column: int) -> FloatArray:
        """Conditional means (W, K) of x_i given x_1 ... x_{i-1}, in each component."""
        before = np.einsum("wlj,jl->wj", e[:, :column], self.factors[:, column, :column])
        return self.means[:, column] + before


def _score(log_weights: FloatArray, e: FloatArray) -> FloatArray:
    """Phi^-1(sum_j W_j Phi(e_j)), (W,), computed from the smaller tail."""
    from scipy.special import log_ndtr, logsumexp, ndtri_exp

    total = logsumexp(log_weights, axis=1)
    below = np.minimum(logsumexp(log_weights + log_ndtr(e), axis=1) - total, 0.0)
    above = np.minimum(logsumexp(log_weights + log_ndtr(-e), axis=1) - total, 0.0)
    return np.where(below < above, ndtri_exp(below), -ndtri_exp(above))
