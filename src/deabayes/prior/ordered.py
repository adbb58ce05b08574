"""Parameters that ascend with a minimum ratio, such as time constants and exponents."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.prior.distributions import Distribution, LogNormal, LogUniform
from deabayes.prior.scores import UNRESOLVED_SCORE

LARGEST_SCORE = 37.0
ROUNDING = 1e-12
TIED = math.log1p(-0.5 * math.erfc(UNRESOLVED_SCORE / math.sqrt(2.0)))
"""log Phi(UNRESOLVED_SCORE), used for tied values."""


@dataclass(frozen=True)
class Ordered:
    r"""n parameters that ascend, theta_{k+1} >= ratio theta_k, as order statistics.

    With u_(1) < ... < u_(n) the order statistics of n uniforms, made from
    independent ones by 1 - u_(k) = (1 - u_(k-1)) Phi(-z_k)^{1/(n-k+1)}, u_(0) = 0
    (Devroye 1986, V.2.1), theta_k = ratio^{k-1} F^{-1}(u_(k)), so that

    p(theta) = n! prod_k f(theta_k / ratio^{k-1}) / ratio^{k-1}.

    F is the common prior, changed to leave room for the ratios. The upper end of a
    log-uniform prior is divided by ratio^{n-1}. This gives exactly the distribution
    of n independent draws, given that the sorted draws keep the ratio. The median
    of a log-normal prior is divided by ratio^{(n-1)/2}, so that the parameters
    spread around the original median. Other priors are only ordered (ratio 1).

    Built from the smallest upwards, z_k depends on theta_1 .. theta_k only. The
    slowest time constant, which a finite record determines least, then does not
    bend the coordinates of the others. With `from_largest` the order statistics
    are those of the reflected uniforms, and z_k depends on theta_k .. theta_n.
    This suits exponents, of which the largest is determined best.
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
        """Return the block of group `name`.

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

    @cached_property
    def _powers(self) -> FloatArray:
        return np.arange(len(self.columns), 0.0, -1.0)

    def to_parameters(self, z: FloatArray) -> FloatArray:
        return self.factors * self.reduced.from_normal(self.scores(self.log_survivals(z)))

    def to_normal(self, theta: FloatArray) -> FloatArray:
        from scipy.special import log_ndtr

        values, ascending = self._sorted_values(theta)
        log_survivals = log_ndtr(-self._reflected(self.reduced.to_normal(values)))
        return np.where(ascending[:, None], self.from_log_survivals(log_survivals), np.nan)

    def log_survivals(self, z: FloatArray) -> FloatArray:
        """log(1 - u_(k)), (W, n); of the reflected uniforms, if built from the largest."""
        from scipy.special import log_ndtr

        return np.cumsum(log_ndtr(-self._reflected(z)) / self._powers, axis=1)

    def from_log_survivals(self, log_survivals: FloatArray, slack: float = np.inf) -> FloatArray:
        """Return z (W, n); the inverse of `log_survivals`.

        Log survivals that ascend count as tied. A row that ascends by more than `slack` gives NaN.
        """
        from scipy.special import ndtri_exp

        log_steps = log_survivals.copy()
        log_steps[:, 1:] -= log_survivals[:, :-1]
        z = -ndtri_exp(np.where(log_steps >= 0.0, TIED, log_steps * self._powers))
        z[(log_steps > slack).any(axis=1)] = np.nan
        return self._reflected(z)

    def scores(self, log_survivals: FloatArray) -> FloatArray:
        """Phi^-1 of the uniform order statistics, ascending, (W, n)."""
        from scipy.special import ndtri_exp

        scores = np.clip(-ndtri_exp(log_survivals), -LARGEST_SCORE, LARGEST_SCORE)
        return self._reflected(scores)

    def _reflected(self, scores: FloatArray) -> FloatArray:
        """Return scores (W, n), negated and reversed if the block is built from the largest."""
        return -scores[:, ::-1] if self.from_largest else scores

    def log_density(self, theta: FloatArray) -> FloatArray:
        values, ascending = self._sorted_values(theta)
        density = np.sum(self.reduced.log_density(values) - np.log(self.factors), axis=1)
        return np.where(ascending, density + math.lgamma(len(self.columns) + 1.0), -np.inf)

    def _sorted_values(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """theta over its factors, (W, n), and whether this ascends up to rounding, (W,)."""
        values = theta / self.factors
        inside = np.clip(values, *self.reduced.support)
        values = np.where(np.abs(values - inside) <= ROUNDING * np.abs(values), inside, values)
        slack = ROUNDING * (np.abs(values[:, 1:]) + np.abs(values[:, :-1]))
        return values, np.all(np.diff(values, axis=1) >= -slack, axis=1)
