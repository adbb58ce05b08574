"""Univariate priors by name: transforms of a standard normal variable."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deabayes.experiment import FloatArray
from deabayes.prior.scores import (
    SMALLEST_PROBABILITY,
    UNRESOLVED_PROBABILITY,
    between,
    log_normal_density,
    log_normal_mass,
    log_or_nan,
    score,
    score_between,
)

LARGEST_EXPONENT = 700.0


class Distribution(ABC):
    """A continuous distribution of one quantity.

    Settings are finite, unless `infinite_bounds` allows otherwise. Methods are vectorised over
    any shape and issue no warnings. Values outside the support have log density -inf and normal
    score NaN.
    """

    label: ClassVar[str]
    dimensionless: ClassVar[tuple[str, ...]] = ()
    """Names of the settings that have no unit."""
    positive: ClassVar[tuple[str, ...]] = ()
    """Names of the settings that must be positive."""
    infinite_bounds: ClassVar[bool] = False

    def __post_init__(self) -> None:
        lower, upper = self.support
        for field in fields(self):  # type: ignore[arg-type]
            name, value = field.name, getattr(self, field.name)
            free = self.infinite_bounds and name in ("lower", "upper")
            if not (free or math.isfinite(value)):
                raise ValueError(f"{self.label}: {name} must be finite, found {value}")
            if name in self.positive and not value > 0.0:
                raise ValueError(f"{self.label}: {name} must be positive, found {value}")
        if not lower < upper:
            raise ValueError(
                f"{self.label}: lower must be below upper, found lower {lower}, upper {upper}"
            )

    @property
    def support(self) -> tuple[float, float]:
        """Lower and upper end, infinite where unbounded."""
        return -math.inf, math.inf

    @abstractmethod
    def from_normal(self, z: ArrayLike) -> FloatArray:
        """The quantile transform F^-1(Phi(z)) of standard normal values."""

    @abstractmethod
    def to_normal(self, x: ArrayLike) -> FloatArray:
        """The normal score Phi^-1(F(x)); NaN outside the support."""

    @abstractmethod
    def _log_density_inside(self, x: FloatArray) -> ArrayLike:
        """log f(x) for x in the support."""

    def log_density(self, x: ArrayLike) -> FloatArray:
        """log f(x); -inf outside the support, NaN where x is NaN."""
        x = np.asarray(x, dtype=float)
        density = self._log_density_inside(x)
        impossible = ~np.isnan(x) & (np.isnan(density) | ~self._supports(x))
        return np.where(impossible, -np.inf, np.where(np.isnan(x), np.nan, density))

    def _supports(self, x: FloatArray) -> NDArray[np.bool_]:
        lower, upper = self.support
        return (x >= lower) & (x <= upper)

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


@dataclass(frozen=True)
class Normal(Distribution):
    """f(x) = exp(-(x - mean)^2 / 2 sd^2) / (sd sqrt(2 pi))."""

    mean: float
    sd: float
    label: ClassVar[str] = "normal"
    positive: ClassVar[tuple[str, ...]] = ("sd",)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return self.mean + self.sd * np.asarray(z, dtype=float)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return (np.asarray(x, dtype=float) - self.mean) / self.sd

    def _log_density_inside(self, x: FloatArray) -> FloatArray:
        return log_normal_density(self.to_normal(x)) - math.log(self.sd)


@dataclass(frozen=True)
class LogNormal(Distribution):
    """log x is normal with mean log(median) and standard deviation sigma."""

    median: float
    sigma: float
    label: ClassVar[str] = "log-normal"
    dimensionless: ClassVar[tuple[str, ...]] = ("sigma",)
    positive: ClassVar[tuple[str, ...]] = ("median", "sigma")

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    def from_normal(self, z: ArrayLike) -> FloatArray:
        log_x = math.log(self.median) + self.sigma * np.asarray(z, dtype=float)
        return np.exp(np.clip(log_x, -LARGEST_EXPONENT, LARGEST_EXPONENT))

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return (log_or_nan(x) - math.log(self.median)) / self.sigma

    def _log_density_inside(self, x: FloatArray) -> FloatArray:
        log_x = log_or_nan(x)
        z = (log_x - math.log(self.median)) / self.sigma
        return log_normal_density(z) - math.log(self.sigma) - log_x


@dataclass(frozen=True)
class HalfNormal(Distribution):
    """The absolute value of a normal variable of mean 0 and standard deviation sd."""

    sd: float
    label: ClassVar[str] = "half-normal"
    positive: ClassVar[tuple[str, ...]] = ("sd",)

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

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

    def _log_density_inside(self, x: FloatArray) -> FloatArray:
        return log_normal_density(x / self.sd) + math.log(2.0 / self.sd)


class Bounded(Distribution):
    """A distribution between two bounds, which are settings."""

    lower: float
    upper: float

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper


@dataclass(frozen=True)
class Uniform(Bounded):
    """f(x) = 1 / (upper - lower) between the bounds."""

    lower: float
    upper: float
    label: ClassVar[str] = "uniform"

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return between(self.lower, self.upper, z)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return score_between(self.lower, self.upper, np.asarray(x, dtype=float))

    def _log_density_inside(self, x: FloatArray) -> float:
        return -math.log(self.upper - self.lower)


@dataclass(frozen=True)
class LogUniform(Bounded):
    """f(x) = 1 / (x log(upper / lower)) between the positive bounds."""

    lower: float
    upper: float
    label: ClassVar[str] = "log-uniform"
    positive: ClassVar[tuple[str, ...]] = ("lower",)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        x = np.exp(between(math.log(self.lower), math.log(self.upper), z))
        return np.clip(x, self.lower, self.upper)  # exp(log(bound)) may step outside by one ulp

    def to_normal(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        scores = score_between(math.log(self.lower), math.log(self.upper), log_or_nan(x), 1e-14)
        return np.where(self._supports(x), scores, np.nan)

    def _log_density_inside(self, x: FloatArray) -> FloatArray:
        return -log_or_nan(x) - math.log(math.log(self.upper / self.lower))


@dataclass(frozen=True)
class TruncatedNormal(Bounded):
    """A normal distribution restricted to [lower, upper]; either end may be infinite."""

    mean: float
    sd: float
    lower: float = -math.inf
    upper: float = math.inf
    label: ClassVar[str] = "truncated normal"
    positive: ClassVar[tuple[str, ...]] = ("sd",)
    infinite_bounds: ClassVar[bool] = True

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
        inside = self._supports(x)
        scaled = np.where(inside, (x - self.mean) / self.sd, np.clip(0.0, a, b))
        log_mass = log_normal_mass(a, b)
        below = _resolved(np.minimum(log_normal_mass(a, scaled) - log_mass, 0.0))
        above = _resolved(np.minimum(log_normal_mass(scaled, b) - log_mass, 0.0))
        return np.where(
            inside, np.where(below < above, ndtri_exp(below), -ndtri_exp(above)), np.nan
        )

    def _log_density_inside(self, x: FloatArray) -> FloatArray:
        log_density = log_normal_density((x - self.mean) / self.sd) - math.log(self.sd)
        return log_density - log_normal_mass(*self._ends())


def _resolved(log_probability: FloatArray) -> FloatArray:
    """Replace -inf by the log probability that stands for a value on a bound."""
    return np.where(np.isneginf(log_probability), math.log(UNRESOLVED_PROBABILITY), log_probability)


__all__ = [
    "REGISTRY",
    "Distribution",
    "FloatArray",
    "HalfNormal",
    "LogNormal",
    "LogUniform",
    "Normal",
    "TruncatedNormal",
    "Uniform",
    "format_number",
]

REGISTRY: dict[str, type[Distribution]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
    "loguniform": LogUniform,
    "halfnormal": HalfNormal,
    "truncated_normal": TruncatedNormal,
}
"""Name of a distribution in a config -> its class."""
