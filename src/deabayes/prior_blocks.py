"""Groups of parameters that are transformed from standard normals together.

Each block owns some columns of z and of theta, and maps one to the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from deabayes.distributions import Distribution, LogNormal, LogUniform
from deabayes.faults import UserError
from deabayes.normal_scores import (
    UNRESOLVED_SCORE,
    FloatArray,
    log_normal_density,
    log_or_nan,
)

LARGEST_SCORE = 37.0
ROUNDING = 1e-12
FEWEST_DRAWS_PER_PARAMETER = 10


class Block(Protocol):
    """What `Prior` needs of a block; arrays (W, k) are its own columns."""

    @property
    def columns(self) -> tuple[int, ...]: ...

    def to_parameters(self, z: FloatArray) -> FloatArray: ...

    def to_normal(self, theta: FloatArray) -> FloatArray: ...

    def log_density(self, theta: FloatArray) -> FloatArray:
        """Summed over the columns, (W,)."""
        ...


@dataclass(frozen=True)
class Independent:
    """Parameters of any distribution, each for itself."""

    columns: tuple[int, ...]
    distributions: tuple[Distribution, ...]

    def to_parameters(self, z: FloatArray) -> FloatArray:
        return np.column_stack([d.from_normal(z[:, k]) for k, d in enumerate(self.distributions)])

    def to_normal(self, theta: FloatArray) -> FloatArray:
        return np.column_stack([d.to_normal(theta[:, k]) for k, d in enumerate(self.distributions)])

    def log_density(self, theta: FloatArray) -> FloatArray:
        densities = (d.log_density(theta[:, k]) for k, d in enumerate(self.distributions))
        return np.sum(np.stack(list(densities)), axis=0)


@dataclass(frozen=True)
class LogNormals:
    """Log-normal parameters, all in one array operation: most parameters are."""

    columns: tuple[int, ...]
    log_medians: FloatArray
    sigmas: FloatArray

    @classmethod
    def of(cls, columns: tuple[int, ...], distributions: tuple[LogNormal, ...]) -> LogNormals:
        return cls(
            columns,
            np.log([d.median for d in distributions]),
            np.array([d.sigma for d in distributions]),
        )

    def to_parameters(self, z: FloatArray) -> FloatArray:
        return np.exp(np.clip(self.log_medians + self.sigmas * z, -700.0, 700.0))

    def to_normal(self, theta: FloatArray) -> FloatArray:
        return (log_or_nan(theta) - self.log_medians) / self.sigmas

    def log_density(self, theta: FloatArray) -> FloatArray:
        log_theta = log_or_nan(theta)
        z = (log_theta - self.log_medians) / self.sigmas
        density = log_normal_density(z) - np.log(self.sigmas) - log_theta
        return np.sum(density, axis=1)


@dataclass(frozen=True)
class Ordered:
    r"""n parameters that ascend, theta_{k+1} >= ratio theta_k, as order statistics.

    With u_(1) < ... < u_(n) the order statistics of n uniforms, made from
    independent ones by 1 - u_(k) = (1 - u_(k-1)) Phi(-z_k)^{1/(n-k+1)}, u_(0) = 0
    (Devroye 1986, V.2.1), theta_k = ratio^{k-1} F^{-1}(u_(k)), so that

    p(theta) = n! prod_k f(theta_k / ratio^{k-1}) / ratio^{k-1}.

    F is the common prior, shortened to leave room for the gaps: for a
    log-uniform one its upper end is divided by ratio^{n-1}, which gives exactly
    the law of n independent draws that, sorted, keep the ratio; for a log-normal
    one the median is divided by ratio^{(n-1)/2}, which spreads the sorted draws
    about it. Other priors are ordered only (ratio 1).

    Made so from the smallest upwards, z_k depends on theta_1 .. theta_k only: the
    slowest time constant, which a record of finite length determines least, does
    not bend the coordinates of the others. With `from_largest` the order
    statistics are those of the reflected uniforms, and z_k depends on theta_k ..
    theta_n: for exponents, of which the largest is determined best.
    """

    columns: tuple[int, ...]
    reduced: Distribution
    factors: FloatArray
    from_largest: bool = False

    @classmethod
    def of(
        cls,
        name: str,
        columns: tuple[int, ...],
        prior: Distribution,
        minimum_ratio: float,
        from_largest: bool = False,
    ) -> Ordered:
        """The block of group `name`.

        Raises
        ------
        UserError : the bounds leave no room for the ratio.
        """
        size = len(columns)
        if not (math.isfinite(minimum_ratio) and minimum_ratio >= 1.0):
            raise UserError(f"prior of {name}: minimum_ratio is {minimum_ratio}; give 1 or more")
        span = minimum_ratio ** (size - 1)
        if isinstance(prior, LogUniform):
            if not prior.upper / span > prior.lower:
                raise UserError(
                    f"prior of {name}: {size} values at least a factor {minimum_ratio:g} apart "
                    f"do not fit between {prior.lower:g} and {prior.upper:g}; widen the bounds or "
                    "lower minimum_ratio"
                )
            reduced: Distribution = replace(prior, upper=prior.upper / span)
        elif isinstance(prior, LogNormal):
            reduced = replace(prior, median=prior.median / math.sqrt(span))
        else:
            return cls(columns, prior, np.ones(size), from_largest)
        factors = np.asarray(minimum_ratio ** np.arange(size), dtype=np.float64)
        return cls(columns, reduced, factors, from_largest)

    @property
    def _powers(self) -> FloatArray:
        return np.arange(len(self.columns), 0.0, -1.0)

    def to_parameters(self, z: FloatArray) -> FloatArray:
        from scipy.special import log_ndtr, ndtri_exp

        log_survivals = np.cumsum(log_ndtr(-self._reflected(z)) / self._powers, axis=1)
        scores = np.clip(-ndtri_exp(log_survivals), -LARGEST_SCORE, LARGEST_SCORE)
        return self.factors * self.reduced.from_normal(self._reflected(scores))

    def to_normal(self, theta: FloatArray) -> FloatArray:
        from scipy.special import log_ndtr, ndtri_exp

        values, ascending = self._sorted_values(theta)
        log_survivals = log_ndtr(-self._reflected(self.reduced.to_normal(values)))
        before = np.concatenate([np.zeros((len(theta), 1)), log_survivals[:, :-1]], axis=1)
        log_steps = log_survivals - before
        tied = log_ndtr(UNRESOLVED_SCORE)
        z = -ndtri_exp(np.where(log_steps >= 0.0, tied, log_steps * self._powers))
        return np.where(ascending[:, None], self._reflected(z), np.nan)

    def _reflected(self, scores: FloatArray) -> FloatArray:
        """Scores (W, n) as they are, or mirrored end to end when built from the largest."""
        return -scores[:, ::-1] if self.from_largest else scores

    def log_density(self, theta: FloatArray) -> FloatArray:
        values, ascending = self._sorted_values(theta)
        density = np.sum(self.reduced.log_density(values) - np.log(self.factors), axis=1)
        return np.where(ascending, density + math.lgamma(len(self.columns) + 1.0), -np.inf)

    def _sorted_values(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """theta without its gaps, (W, n), and whether it ascends, (W,), up to rounding."""
        values = theta / self.factors
        inside = np.clip(values, *self.reduced.support)
        values = np.where(np.abs(values - inside) <= ROUNDING * np.abs(values), inside, values)
        slack = ROUNDING * (np.abs(values[:, 1:]) + np.abs(values[:, :-1]))
        return values, np.all(np.diff(values, axis=1) >= -slack, axis=1)


@dataclass(frozen=True)
class Parts:
    r"""n positive parameters whose sum T has the prior, the fractions uniform on the simplex.

    z_1 gives T; the fractions are broken off a stick, f_k = v_k prod_{j<k} (1 - v_j) with
    1 - v_k = Phi(-z_{k+1})^{1/(n-k)}, k < n (Devroye 1986, XI.4), so that

    p(theta) = (n - 1)! p_T(T) / T^{n-1}.

    Records often fix a sum far better than its parts: it is then a coordinate of its own.
    """

    columns: tuple[int, ...]
    total: Distribution

    @property
    def _powers(self) -> FloatArray:
        return np.arange(len(self.columns) - 1, 0.0, -1.0)

    def to_parameters(self, z: FloatArray) -> FloatArray:
        from scipy.special import log_ndtr

        log_steps = log_ndtr(-z[:, 1:]) / self._powers
        left = np.cumsum(log_steps, axis=1)
        before = np.concatenate([np.zeros((len(z), 1)), left], axis=1)
        broken = np.concatenate([-np.expm1(log_steps), np.ones((len(z), 1))], axis=1)
        return self.total.from_normal(z[:, 0])[:, None] * np.exp(before) * broken

    def to_normal(self, theta: FloatArray) -> FloatArray:
        from scipy.special import ndtri_exp

        theta = np.where(theta > 0.0, theta, np.nan)
        left = np.cumsum(theta[:, ::-1], axis=1)[:, ::-1]
        z = np.empty_like(theta)
        z[:, 0] = self.total.to_normal(left[:, 0])
        with np.errstate(invalid="ignore"):
            z[:, 1:] = -ndtri_exp(np.log(left[:, 1:] / left[:, :-1]) * self._powers)
        return z

    def log_density(self, theta: FloatArray) -> FloatArray:
        total, n = theta.sum(axis=1), len(self.columns)
        found = self.total.log_density(total) + math.lgamma(n) - (n - 1) * log_or_nan(total)
        return np.where(np.all(theta > 0.0, axis=1), found, -np.inf)


class PriorFromPosterior(NamedTuple):
    """Draws of another posterior, to be used as a prior."""

    names: tuple[str, ...]
    draws: FloatArray
    """(S, k), SI."""


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
