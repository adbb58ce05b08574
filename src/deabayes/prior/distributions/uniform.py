"""The uniform distribution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.prior.distributions.base import Distribution, check_ascending, check_finite
from deabayes.prior.distributions.scores import between, outside_is_impossible, score_between


@dataclass(frozen=True)
class Uniform(Distribution):
    """f(x) = 1 / (upper - lower) between the bounds."""

    lower: float
    upper: float
    label: ClassVar[str] = "uniform"

    def __post_init__(self) -> None:
        check_finite(self, "lower", "upper")
        check_ascending(self)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return between(self.lower, self.upper, z)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return score_between(self.lower, self.upper, np.asarray(x, dtype=float))

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x <= self.upper)
        return outside_is_impossible(
            np.where(inside, -math.log(self.upper - self.lower), np.nan), x
        )

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper
