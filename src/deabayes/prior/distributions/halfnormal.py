"""The half-normal distribution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.prior.distributions.base import Distribution, check_finite, check_positive
from deabayes.prior.distributions.scores import (
    SMALLEST_PROBABILITY,
    log_normal_density,
    outside_is_impossible,
    score,
)


@dataclass(frozen=True)
class HalfNormal(Distribution):
    """The absolute value of a normal variable of mean 0 and standard deviation sd."""

    sd: float
    label: ClassVar[str] = "half-normal"

    def __post_init__(self) -> None:
        check_finite(self, "sd")
        check_positive(self, "sd")

    def from_normal(self, z: ArrayLike) -> FloatArray:
        from scipy.special import erfcinv, erfinv, ndtr

        z = np.asarray(z, dtype=float)
        lower = erfinv(ndtr(np.minimum(z, 0.0)))
        upper = erfcinv(np.maximum(ndtr(-np.maximum(z, 0.0)), SMALLEST_PROBABILITY))
        return self.sd * math.sqrt(2.0) * np.where(z < 0.0, lower, upper)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        from scipy.special import erf, erfc

        scaled = np.asarray(x, dtype=float) / (self.sd * math.sqrt(2.0))
        return np.where(scaled >= 0.0, score(erf(scaled), erfc(scaled)), np.nan)

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        log_density = log_normal_density(x / self.sd) + math.log(2.0 / self.sd)
        return outside_is_impossible(np.where(x >= 0.0, log_density, np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf
