"""The log-normal distribution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.prior.distributions.base import Distribution, check_finite, check_positive
from deabayes.prior.distributions.scores import (
    log_normal_density,
    log_or_nan,
    outside_is_impossible,
)

LARGEST_EXPONENT = 700.0


@dataclass(frozen=True)
class LogNormal(Distribution):
    """log x is normal with mean log(median) and standard deviation sigma."""

    median: float
    sigma: float
    label: ClassVar[str] = "log-normal"
    dimensionless: ClassVar[tuple[str, ...]] = ("sigma",)

    def __post_init__(self) -> None:
        check_finite(self, "median", "sigma")
        check_positive(self, "median", "sigma")

    def from_normal(self, z: ArrayLike) -> FloatArray:
        log_x = math.log(self.median) + self.sigma * np.asarray(z, dtype=float)
        return np.exp(np.clip(log_x, -LARGEST_EXPONENT, LARGEST_EXPONENT))

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return (log_or_nan(x) - math.log(self.median)) / self.sigma

    def log_density(self, x: ArrayLike) -> FloatArray:
        log_x = log_or_nan(x)
        z = (log_x - math.log(self.median)) / self.sigma
        return outside_is_impossible(log_normal_density(z) - math.log(self.sigma) - log_x, x)

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf
