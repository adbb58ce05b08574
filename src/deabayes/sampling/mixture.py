"""Mixtures of Student-t densities that are fitted to draws, frozen and used as proposals."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from math import lgamma, log, pi

import numpy as np

from deabayes.experiment import FloatArray

RandomSource = np.random.Generator | np.random.RandomState

DEGREES_OF_FREEDOM = 7.0
MOST_ITERATIONS = 20
"""Most iterations of a fit; a proposal need not be optimal, and fits take much of the run time."""


@dataclass(frozen=True)
class Mixture:
    """A normalised mixture of multivariate Student-t densities.

    Attributes
    ----------
    weights : (K,), summing to one.
    means : (K, d).
    factors : (K, d, d) lower Cholesky factors of the scale matrices.
    degrees_of_freedom : the same for every component.
    """

    weights: FloatArray
    means: FloatArray
    factors: FloatArray
    degrees_of_freedom: float = DEGREES_OF_FREEDOM

    @property
    def dimension(self) -> int:
        return int(self.means.shape[1])

    @cached_property
    def _inverse_factors(self) -> FloatArray:
        return np.stack([np.linalg.inv(factor) for factor in self.factors])

    @cached_property
    def _log_normalisation(self) -> FloatArray:
        """Log of weight times the normalising constant of each component, (K,)."""
        d, df = self.dimension, self.degrees_of_freedom
        constant = lgamma((df + d) / 2) - lgamma(df / 2) - d / 2 * log(df * pi)
        log_root_determinants = np.log(np.diagonal(self.factors, axis1=1, axis2=2)).sum(axis=1)
        return np.log(self.weights) + constant - log_root_determinants

    def component_log_density(self, z: FloatArray) -> FloatArray:
        """Return the log of weight times density of every component at z (W, d): (W, K)."""
        d, df = self.dimension, self.degrees_of_freedom
        scaled = np.matmul(z[None] - self.means[:, None], self._inverse_factors.transpose(0, 2, 1))
        distance = np.einsum("kwd,kwd->wk", scaled, scaled)
        return self._log_normalisation - (df + d) / 2 * np.log1p(distance / df)

    def log_density(self, z: FloatArray) -> FloatArray:
        """Return the normalised log density (W,) at z (W, d)."""
        terms = self.component_log_density(np.atleast_2d(z))
        largest = terms.max(axis=1)
        return largest + np.log(np.exp(terms - largest[:, None]).sum(axis=1))

    def sample(self, rng: RandomSource, n: int) -> FloatArray:
        """Draw n points (n, d)."""
        component = rng.choice(len(self.weights), size=n, p=self.weights)
        normal = rng.standard_normal((n, self.dimension))
        stretch = np.sqrt(self.degrees_of_freedom / rng.chisquare(self.degrees_of_freedom, size=n))
        step = np.matmul(self.factors[component], normal[:, :, None])[:, :, 0]
        return self.means[component] + step * stretch[:, None]


def fit(
    samples: FloatArray,
    components: int,
    rng: np.random.Generator,
    degrees_of_freedom: float = DEGREES_OF_FREEDOM,
) -> Mixture:
    """Fit a mixture to samples (n, d) and freeze it.

    A Gaussian mixture is fitted by expectation maximisation on whitened samples. Each covariance
    is shrunk towards the pooled within-component covariance with the weight of d + 1 samples. It
    then serves as the scale matrix of a Student-t density, so that the mixture is wider than the
    samples. Fewer components are used if there are too few distinct samples.

    Raises
    ------
    ValueError : if fewer than two samples are finite.
    """
    samples = np.asarray(samples, dtype=float)
    samples = samples[np.isfinite(samples).all(axis=1)]
    if len(samples) < 2:
        raise ValueError(f"a mixture needs at least 2 finite samples; {len(samples)} given")
    centre, factor = samples.mean(axis=0), covariance_factor(np.cov(samples, rowvar=False))
    white = np.linalg.solve(factor, (samples - centre).T).T
    weights, means, covariances = _gaussian_mixture(white, components, rng)
    factors = np.stack([factor @ covariance_factor(covariance) for covariance in covariances])
    return Mixture(weights, centre + means @ factor.T, factors, degrees_of_freedom)


def covariance_factor(covariance: FloatArray) -> FloatArray:
    """Return the Cholesky factor of a covariance, which is regularised just enough to have one."""
    covariance = np.atleast_2d(covariance)
    scale = np.sqrt(np.diagonal(covariance))
    scale = np.where(scale > 0, scale, max(1e-6 * scale.max(), 1e-8))
    correlation = covariance / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    for lift in 10.0 ** np.arange(-12, 1):
        try:
            return scale[:, None] * np.linalg.cholesky(correlation + lift * np.eye(len(scale)))
        except np.linalg.LinAlgError:
            continue
    return np.diag(scale)


def _gaussian_mixture(
    white: FloatArray, components: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weights, means and shrunk covariances of a Gaussian mixture on whitened samples."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture

    n, d = white.shape
    distinct = len(np.unique(white, axis=0))
    components = max(1, min(components, distinct // (2 * (d + 1))))
    model = GaussianMixture(
        components,
        reg_covar=1e-6,
        max_iter=MOST_ITERATIONS,
        init_params="k-means++",
        random_state=int(rng.integers(2**31)),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        responsibility = model.fit(white).predict_proba(white)
    counts = responsibility.sum(axis=0)
    within = np.einsum("k,kij->ij", counts / n, model.covariances_)
    prior_weight = d + 1.0
    shrunk = (counts[:, None, None] * model.covariances_ + prior_weight * within) / (
        counts[:, None, None] + prior_weight
    )
    return (counts + 1.0) / (n + components), model.means_, shrunk
