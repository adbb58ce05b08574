"""What a univariate prior is: a transform of a standard normal variable.

A sampler that works in z, where every prior is N(0, 1), needs only the quantile
transform x = F^-1(Phi(z)) of each distribution and its inverse.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import fields
from typing import ClassVar

from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray


class Distribution(ABC):
    """A continuous distribution of one quantity.

    Methods are vectorised over any shape and warn of nothing: values outside
    the support have log density -inf and a NaN normal score.
    """

    label: ClassVar[str]
    dimensionless: ClassVar[tuple[str, ...]] = ()
    """Settings without the quantity's unit."""

    @abstractmethod
    def from_normal(self, z: ArrayLike) -> FloatArray:
        """The quantile transform F^-1(Phi(z)) of standard normal values."""

    @abstractmethod
    def to_normal(self, x: ArrayLike) -> FloatArray:
        """The normal score Phi^-1(F(x)); NaN outside the support."""

    @abstractmethod
    def log_density(self, x: ArrayLike) -> FloatArray:
        """log f(x); -inf outside the support."""

    @property
    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Lower and upper end, infinite where unbounded."""

    def describe(self) -> str:
        """Name and settings in words: ``log-normal, median 35e3, sigma 0.5``."""
        settings = (f"{f.name} {format_number(getattr(self, f.name))}" for f in fields(self))  # type: ignore[arg-type]
        return ", ".join((self.label, *settings))


def format_number(value: float) -> str:
    """Four digits, with an exponent in steps of three outside 0.01 to 9999: ``35e3``."""
    if value == 0.0 or not math.isfinite(value) or 0.01 <= abs(value) < 1e4:
        return f"{value:.4g}"
    exponent = 3 * math.floor(math.log10(abs(value)) / 3)
    return f"{value / 10.0**exponent:.4g}e{exponent}"


def check_finite(distribution: Distribution, *names: str) -> None:
    """Refuse settings that are no finite numbers."""
    for name in names:
        value = getattr(distribution, name)
        if not math.isfinite(value):
            raise ValueError(f"{distribution.label}: {name} must be finite, found {value}")


def check_positive(distribution: Distribution, *names: str) -> None:
    """Refuse settings that are not above zero."""
    for name in names:
        value = getattr(distribution, name)
        if not value > 0.0:
            raise ValueError(f"{distribution.label}: {name} must be positive, found {value}")


def check_ascending(distribution: Distribution) -> None:
    """Refuse bounds that enclose nothing."""
    lower, upper = distribution.support
    if not lower < upper:
        raise ValueError(
            f"{distribution.label}: lower must be below upper, found lower {lower}, upper {upper}"
        )
