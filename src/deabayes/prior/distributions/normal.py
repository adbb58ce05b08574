"""The normal distribution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.prior.distributions.base import Distribution, check_finite, check_positive
from deabayes.prior.distributions.scores import log_normal_density


@dataclass(frozen=True)
class Normal(Distribution):
    """f(x) = exp(-(x - mean)^2 / 2 sd^2) / (sd sqrt(2 pi))."""

    mean: float
    sd: float
    label: ClassVar[str] = "normal"

    def __post_init__(self) -> None:
        check_finite(self, "mean", "sd")
        check_positive(self, "sd")

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return self.mean + self.sd * np.asarray(z, dtype=float)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return (np.asarray(x, dtype=float) - self.mean) / self.sd

    def log_density(self, x: ArrayLike) -> FloatArray:
        return log_normal_density(self.to_normal(x)) - math.log(self.sd)

    @property
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf
