"""The normal distribution between bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.prior.distributions.base import (
    Distribution,
    check_ascending,
    check_finite,
    check_positive,
)
from deabayes.prior.distributions.scores import (
    UNRESOLVED_PROBABILITY,
    log_normal_density,
    log_normal_mass,
    outside_is_impossible,
)


@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """A normal distribution restricted to [lower, upper]; either end may be infinite."""

    mean: float
    sd: float
    lower: float = -math.inf
    upper: float = math.inf
    label: ClassVar[str] = "truncated normal"

    def __post_init__(self) -> None:
        check_finite(self, "mean", "sd")
        check_positive(self, "sd")
        check_ascending(self)

    def _ends(self) -> tuple[float, float]:
        return (self.lower - self.mean) / self.sd, (self.upper - self.mean) / self.sd

    def from_normal(self, z: ArrayLike) -> FloatArray:
        from scipy.special import log_ndtr, ndtri_exp

        z = np.asarray(z, dtype=float)
        a, b = self._ends()
        log_mass = log_normal_mass(a, b)
        with np.errstate(invalid="ignore"):  # NaN stays NaN
            log_below = np.logaddexp(log_ndtr(a), log_ndtr(z) + log_mass)
            log_above = np.logaddexp(log_ndtr(-b), log_ndtr(-z) + log_mass)
        left = log_below < log_above
        scaled = np.where(
            left, ndtri_exp(np.minimum(log_below, 0.0)), -ndtri_exp(np.minimum(log_above, 0.0))
        )
        return np.clip(self.mean + self.sd * scaled, self.lower, self.upper)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        from scipy.special import ndtri_exp

        x = np.asarray(x, dtype=float)
        a, b = self._ends()
        inside = (x >= self.lower) & (x <= self.upper)
        scaled = np.where(inside, (x - self.mean) / self.sd, np.clip(0.0, a, b))
        log_mass = log_normal_mass(a, b)
        below = _resolved(np.minimum(log_normal_mass(a, scaled) - log_mass, 0.0))
        above = _resolved(np.minimum(log_normal_mass(scaled, b) - log_mass, 0.0))
        score = np.where(below < above, ndtri_exp(below), -ndtri_exp(above))
        return np.where(inside, score, np.nan)

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x <= self.upper)
        log_density = log_normal_density((x - self.mean) / self.sd) - math.log(self.sd)
        log_density = log_density - log_normal_mass(*self._ends())
        return outside_is_impossible(np.where(inside, log_density, np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper


def _resolved(log_probability: FloatArray) -> FloatArray:
    """With the log probability of a value on a bound in place of -inf."""
    return np.where(np.isneginf(log_probability), math.log(UNRESOLVED_PROBABILITY), log_probability)
