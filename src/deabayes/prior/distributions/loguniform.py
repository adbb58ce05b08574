"""The log-uniform distribution."""

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
    between,
    log_or_nan,
    outside_is_impossible,
    score_between,
)


@dataclass(frozen=True)
class LogUniform(Distribution):
    """f(x) = 1 / (x log(upper / lower)) between the positive bounds."""

    lower: float
    upper: float
    label: ClassVar[str] = "log-uniform"

    def __post_init__(self) -> None:
        check_finite(self, "lower", "upper")
        check_positive(self, "lower")
        check_ascending(self)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        x = np.exp(between(math.log(self.lower), math.log(self.upper), z))
        return np.clip(x, self.lower, self.upper)  # exp(log(bound)) may step outside by one ulp

    def to_normal(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        scores = score_between(math.log(self.lower), math.log(self.upper), log_or_nan(x), 1e-14)
        return np.where((x >= self.lower) & (x <= self.upper), scores, np.nan)

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x <= self.upper)
        log_width = math.log(math.log(self.upper / self.lower))
        return outside_is_impossible(np.where(inside, -log_or_nan(x) - log_width, np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper
