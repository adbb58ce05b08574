"""Univariate priors, each written as a transform of a standard normal variable.

A sampler that works in z, where every prior is N(0, 1), needs only the quantile
transform x = F^-1(Phi(z)) of each distribution and its inverse.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deabayes.faults import UserError, nearest

FloatArray = NDArray[np.float64]
LARGEST_EXPONENT = 700.0
SMALLEST_PROBABILITY = 1e-300
LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


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


@dataclass(frozen=True)
class Normal(Distribution):
    """f(x) = exp(-(x - mean)^2 / 2 sd^2) / (sd sqrt(2 pi))."""

    mean: float
    sd: float
    label: ClassVar[str] = "normal"

    def __post_init__(self) -> None:
        _check_finite(self, "mean", "sd")
        _check_positive(self, "sd")

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return self.mean + self.sd * np.asarray(z, dtype=float)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return (np.asarray(x, dtype=float) - self.mean) / self.sd

    def log_density(self, x: ArrayLike) -> FloatArray:
        return _log_normal_density(self.to_normal(x)) - math.log(self.sd)

    @property
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf


@dataclass(frozen=True)
class LogNormal(Distribution):
    """log x is normal with mean log(median) and standard deviation sigma."""

    median: float
    sigma: float
    label: ClassVar[str] = "log-normal"
    dimensionless: ClassVar[tuple[str, ...]] = ("sigma",)

    def __post_init__(self) -> None:
        _check_finite(self, "median", "sigma")
        _check_positive(self, "median", "sigma")

    def from_normal(self, z: ArrayLike) -> FloatArray:
        log_x = math.log(self.median) + self.sigma * np.asarray(z, dtype=float)
        return np.exp(np.clip(log_x, -LARGEST_EXPONENT, LARGEST_EXPONENT))

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return (_log(x) - math.log(self.median)) / self.sigma

    def log_density(self, x: ArrayLike) -> FloatArray:
        log_x = _log(x)
        z = (log_x - math.log(self.median)) / self.sigma
        return _minus_infinity(_log_normal_density(z) - math.log(self.sigma) - log_x, x)

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf


@dataclass(frozen=True)
class Uniform(Distribution):
    """f(x) = 1 / (upper - lower) between the bounds."""

    lower: float
    upper: float
    label: ClassVar[str] = "uniform"

    def __post_init__(self) -> None:
        _check_finite(self, "lower", "upper")
        _check_ascending(self)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return _between(self.lower, self.upper, z)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        return _score_between(self.lower, self.upper, np.asarray(x, dtype=float))

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x <= self.upper)
        return _minus_infinity(np.where(inside, -math.log(self.upper - self.lower), np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper


@dataclass(frozen=True)
class LogUniform(Distribution):
    """f(x) = 1 / (x log(upper / lower)) between the positive bounds."""

    lower: float
    upper: float
    label: ClassVar[str] = "log-uniform"

    def __post_init__(self) -> None:
        _check_finite(self, "lower", "upper")
        _check_positive(self, "lower")
        _check_ascending(self)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        x = np.exp(_between(math.log(self.lower), math.log(self.upper), z))
        return np.clip(x, self.lower, self.upper)  # exp(log(bound)) may step outside by one ulp

    def to_normal(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        scores = _score_between(math.log(self.lower), math.log(self.upper), _log(x), 1e-14)
        return np.where((x >= self.lower) & (x <= self.upper), scores, np.nan)

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x <= self.upper)
        log_width = math.log(math.log(self.upper / self.lower))
        return _minus_infinity(np.where(inside, -_log(x) - log_width, np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper


@dataclass(frozen=True)
class HalfNormal(Distribution):
    """The absolute value of a normal variable of mean 0 and standard deviation sd."""

    sd: float
    label: ClassVar[str] = "half-normal"

    def __post_init__(self) -> None:
        _check_finite(self, "sd")
        _check_positive(self, "sd")

    def from_normal(self, z: ArrayLike) -> FloatArray:
        from scipy.special import erfcinv, erfinv, ndtr

        z = np.asarray(z, dtype=float)
        lower = erfinv(ndtr(np.minimum(z, 0.0)))
        upper = erfcinv(np.maximum(ndtr(-np.maximum(z, 0.0)), SMALLEST_PROBABILITY))
        return self.sd * math.sqrt(2.0) * np.where(z < 0.0, lower, upper)

    def to_normal(self, x: ArrayLike) -> FloatArray:
        from scipy.special import erf, erfc

        scaled = np.asarray(x, dtype=float) / (self.sd * math.sqrt(2.0))
        return np.where(scaled >= 0.0, _score(erf(scaled), erfc(scaled)), np.nan)

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        log_density = _log_normal_density(x / self.sd) + math.log(2.0 / self.sd)
        return _minus_infinity(np.where(x >= 0.0, log_density, np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf


@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """A normal distribution restricted to [lower, upper]; either end may be infinite."""

    mean: float
    sd: float
    lower: float = -math.inf
    upper: float = math.inf
    label: ClassVar[str] = "truncated normal"

    def __post_init__(self) -> None:
        _check_finite(self, "mean", "sd")
        _check_positive(self, "sd")
        _check_ascending(self)

    def _ends(self) -> tuple[float, float]:
        return (self.lower - self.mean) / self.sd, (self.upper - self.mean) / self.sd

    def from_normal(self, z: ArrayLike) -> FloatArray:
        from scipy.special import log_ndtr, ndtri_exp

        z = np.asarray(z, dtype=float)
        a, b = self._ends()
        log_mass = _log_normal_mass(a, b)
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
        log_mass = _log_normal_mass(a, b)
        log_floor = math.log(SMALLEST_PROBABILITY)
        below = np.clip(_log_normal_mass(a, scaled) - log_mass, log_floor, 0.0)
        above = np.clip(_log_normal_mass(scaled, b) - log_mass, log_floor, 0.0)
        score = np.where(below < above, ndtri_exp(below), -ndtri_exp(above))
        return np.where(inside, score, np.nan)

    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x <= self.upper)
        log_density = _log_normal_density((x - self.mean) / self.sd) - math.log(self.sd)
        log_density = log_density - _log_normal_mass(*self._ends())
        return _minus_infinity(np.where(inside, log_density, np.nan), x)

    @property
    def support(self) -> tuple[float, float]:
        return self.lower, self.upper


REGISTRY: dict[str, type[Distribution]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
    "loguniform": LogUniform,
    "halfnormal": HalfNormal,
    "truncated_normal": TruncatedNormal,
}


def from_settings(settings: Mapping[str, object], unit: str, where: str) -> Distribution:
    """A distribution from a config entry, with its units checked.

    Parameters
    ----------
    settings : ``{"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}``;
        numbers are in SI units, texts carry their unit.
    unit : SI unit of the quantity.
    where : file and key, for the message.

    Raises
    ------
    UserError : unknown distribution or setting, a missing one, a wrong unit, or
        values that make no distribution.
    """
    if not isinstance(settings, Mapping):
        raise UserError(
            f"{where}: expected a mapping such as {{distribution: lognormal, median: 1, sigma: 0.5}}, "
            f"found {settings!r}"
        )
    name = settings.get("distribution")
    if name not in REGISTRY:
        hint = nearest(str(name), REGISTRY)
        raise UserError(f"{where}: unknown distribution {name!r}{hint}")
    kind = REGISTRY[str(name)]
    values = {key: value for key, value in settings.items() if key != "distribution"}
    _check_keys(kind, str(name), values, where)
    numbers = {
        key: _number(value, "1" if key in kind.dimensionless else unit, f"{where}.{key}")
        for key, value in values.items()
    }
    try:
        return kind(**numbers)
    except ValueError as error:
        raise UserError(f"{where}: {error}") from None


def _check_keys(
    kind: type[Distribution], name: str, values: Mapping[str, object], where: str
) -> None:
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            raise UserError(f"{where}: {name} has no setting {key!r}{nearest(key, known)}")
    missing = [k for k, f in known.items() if k not in values and f.default is MISSING]
    if missing:
        raise UserError(f"{where}: {name} needs {' and '.join(missing)}; add {missing[0]}")


def _number(value: object, unit: str, where: str) -> float:
    """A number as it is, or a text such as ``35 kPa`` in SI units."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, str):
        raise UserError(f"{where}: expected a number or a text such as '2 {unit}', found {value!r}")
    try:
        return float(value)
    except ValueError:
        from deabayes.units import parse_quantity

        return float(parse_quantity(value, unit, where))


def format_number(value: float) -> str:
    """Four digits, with an exponent in steps of three outside 0.01 to 9999: ``35e3``."""
    if value == 0.0 or not math.isfinite(value) or 0.01 <= abs(value) < 1e4:
        return f"{value:.4g}"
    exponent = 3 * math.floor(math.log10(abs(value)) / 3)
    return f"{value / 10.0**exponent:.4g}e{exponent}"


def _check_finite(distribution: Distribution, *names: str) -> None:
    for name in names:
        value = getattr(distribution, name)
        if not math.isfinite(value):
            raise ValueError(f"{distribution.label}: {name} must be finite, found {value}")


def _check_positive(distribution: Distribution, *names: str) -> None:
    for name in names:
        value = getattr(distribution, name)
        if not value > 0.0:
            raise ValueError(f"{distribution.label}: {name} must be positive, found {value}")


def _check_ascending(distribution: Distribution) -> None:
    lower, upper = distribution.support
    if not lower < upper:
        raise ValueError(
            f"{distribution.label}: lower must be below upper, found lower {lower}, upper {upper}"
        )


def _log(x: ArrayLike) -> FloatArray:
    """log x, NaN where x <= 0, without a warning."""
    x = np.asarray(x, dtype=float)
    return np.log(np.where(x > 0.0, x, np.nan))


def _minus_infinity(log_density: FloatArray, x: ArrayLike) -> FloatArray:
    """-inf where the density is undefined because x is outside; NaN stays NaN with x."""
    outside = np.isnan(log_density) & ~np.isnan(np.asarray(x, dtype=float))
    return np.where(outside, -np.inf, log_density)


def _log_normal_density(z: FloatArray) -> FloatArray:
    return -0.5 * z * z - LOG_SQRT_2PI


def _between(lower: float, upper: float, z: ArrayLike) -> FloatArray:
    """lower + (upper - lower) Phi(z), measured from the nearer end."""
    from scipy.special import ndtr

    z = np.asarray(z, dtype=float)
    part = (upper - lower) * ndtr(-np.abs(z))
    return np.where(z < 0.0, lower + part, upper - part)


def _score_between(lower: float, upper: float, x: FloatArray, slack: float = 0.0) -> FloatArray:
    below = (x - lower) / (upper - lower)
    above = (upper - x) / (upper - lower)
    inside = (below >= -slack) & (above >= -slack)
    return np.where(inside, _score(np.abs(below), np.abs(above)), np.nan)


def _score(below: FloatArray, above: FloatArray) -> FloatArray:
    """Phi^-1 of a probability given with its complement, from the smaller of the two."""
    from scipy.special import ndtri

    tail = ndtri(np.clip(np.minimum(below, above), SMALLEST_PROBABILITY, 0.5))
    return np.where(below < above, tail, -tail)


def _log_normal_mass(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """log(Phi(b) - Phi(a)) for a <= b, accurate in both tails; -inf for no mass."""
    from scipy.special import log_ndtr

    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    reflect = a > 0.0
    low, high = np.where(reflect, -b, a), np.where(reflect, -a, b)
    log_high, log_low = log_ndtr(high), log_ndtr(low)
    with np.errstate(divide="ignore", invalid="ignore"):
        tails = log_high + np.log(-np.expm1(log_low - log_high))
        across = np.log1p(-np.exp(log_low) - np.exp(log_ndtr(-high)))
    mass = np.where((low < 0.0) & (high > 0.0), across, tails)
    return np.where(a < b, mass, -np.inf)
