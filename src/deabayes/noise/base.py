"""What every noise model offers, its coordinates and its default priors."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.prior.coordinates import log_normals
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter

Draws = Mapping[str, FloatArray]


class NoiseModel(ABC):
    """The law of (response - model) along one record's coordinate.

    Residuals come already divided by the record's scale, so `sigma_*` are in
    units of that scale. `weights` is 1/samples_averaged (N,): the variance of a
    mean of n raw samples' white noise is sigma_white^2 / n. Correlated noise is
    taken as constant over an averaging window.

    All methods take residuals (W, N) and `draws` with this model's parameter
    names without the group's prefix, each (W,). The coordinate may turn back
    (loading, then unloading): correlation decays with the distance travelled.
    One draw never affects another's result.
    """

    name: ClassVar[str]
    diagnostic_only: ClassVar[bool] = False
    """Whether its intervals are known to be too narrow for densely sampled records."""
    adding: ClassVar[tuple[str, ...]] = ()
    """The standard deviations of its white and its correlated part, where it has both."""
    length: ClassVar[str] = ""
    """The parameter that is its correlation length, where it has one."""
    has_white: ClassVar[bool] = True
    """Whether two readings at one place may differ."""

    @abstractmethod
    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        """Parameters, unprefixed, with default priors.

        Parameters
        ----------
        unit : unit of the residuals (`1` when relative to a range).
        scale : typical range of the responses, in `unit` (1 when relative).
        span : typical extent of the coordinate, in `coordinate_unit`;
            correlation lengths have 95 % of their prior below a tenth of it.
        """

    @abstractmethod
    def pointwise_log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        """log p(r_k | r_1..k-1), (W, N); rows with a residual that is not finite are NaN."""

    def log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        """log p(r), (W,): the sum of the pointwise terms, -inf where it is not finite."""
        total = self.pointwise_log_prob(residuals, coordinate, weights, draws).sum(axis=1)
        return np.where(np.isfinite(total), total, -np.inf)

    @abstractmethod
    def innovations(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        """Normal scores of r_k given r_1..k-1, (W, N): iid standard normal if the model holds.

        Phi(innovations) is the probability integral transform.
        """

    @abstractmethod
    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        """One sample per draw: (discrepancy (W, N), white (W, N)); their sum is the residual."""

    @abstractmethod
    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of its correlated and of its white part, (W,) each, on average over a record's points."""

    @abstractmethod
    def spreads(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scale of one residual, of its correlated part alone (W, 1) and of the whole (W, N)."""

    @abstractmethod
    def cumulative(self, scores: FloatArray, draws: Draws) -> FloatArray:
        """Distribution function of one residual, or its correlated part, over its scale, (W, N)."""


def contiguous(values: FloatArray) -> FloatArray:
    """As the kernels take it: float64, C order, copied only if it is not."""
    return np.ascontiguousarray(values, dtype=np.float64)


def variance(sigma: FloatArray) -> FloatArray:
    """sigma^2, contiguous (W,); NaN for a negative sigma."""
    sigma = np.asarray(sigma, dtype=float)
    return np.ascontiguousarray(np.where(sigma >= 0.0, sigma, np.nan) ** 2)


def rate(length: FloatArray) -> FloatArray:
    """1 / length, contiguous (W,); NaN unless the length is positive."""
    length = np.asarray(length, dtype=float)
    return np.ascontiguousarray(1.0 / np.where(length > 0.0, length, np.nan))


@dataclass(frozen=True)
class NoisePair:
    """White and correlated noise that add up: columns of z, and ln s = intercept + slope z.

    The intercept of white noise holds that of the root of w.
    """

    columns: tuple[int, int]
    intercepts: tuple[float, float]
    slopes: tuple[float, float]

    def straighten(self, u: FloatArray) -> float:
        """Put (u_1, u_2) in the places of both; log of the Jacobian."""
        white, correlated = self._logarithms(u)
        u[:, self.columns[0]] = 0.5 * np.logaddexp(2 * white, 2 * correlated)
        u[:, self.columns[1]] = correlated - white
        return float(np.log(self.slopes).sum())

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        total, ratio = u[:, self.columns[0]], u[:, self.columns[1]]
        white = total - 0.5 * np.logaddexp(0.0, 2 * ratio)
        for column, logarithm, intercept, slope in zip(
            self.columns, (white, white + ratio), self.intercepts, self.slopes, strict=True
        ):
            u[:, column] = (logarithm - intercept) / slope

    def _logarithms(self, z: FloatArray) -> list[FloatArray]:
        terms = zip(self.columns, self.intercepts, self.slopes, strict=True)
        return [intercept + slope * z[:, column] for column, intercept, slope in terms]


def noise_coordinates(
    noise: NoiseModel, prior: Prior, weights: Mapping[str, FloatArray], free: frozenset[int]
) -> list[NoisePair]:
    """One for each noise group of which both have log-normal priors of their own.

    Parameters
    ----------
    weights : of white noise at all points of a group's records.
    free : columns with priors of their own.
    """
    pairs: list[NoisePair] = []
    for group, each in weights.items():
        columns = [prior.names.index(f"{group}.{name}") for name in noise.adding]
        normals = log_normals(prior, columns, free)
        if len(normals) == 2:
            white, correlated = (float(np.log(p.median)) for p in normals)
            white += 0.5 * float(np.log(np.mean(each)))
            places, slopes = (columns[0], columns[1]), (normals[0].sigma, normals[1].sigma)
            pairs.append(NoisePair(places, (white, correlated), slopes))
    return pairs


WHITE_FRACTION, WHITE_SIGMA = 0.003, 1.5
CORRELATED_FRACTION, CORRELATED_SIGMA = 0.01, 1.2
OFFSET_FRACTION = 0.001
SHORTEST_LENGTH, LENGTH_FRACTION = 1e-4, 0.1


def white_amplitude(unit: str, scale: float, name: str = "sigma_white") -> Parameter:
    """Standard deviation of the white noise of one raw sample."""
    _check_positive("range of the response", scale)
    return Parameter(
        name,
        r"\sigma_\mathrm{w}",
        unit,
        "standard deviation of white noise, one raw sample",
        LogNormal(WHITE_FRACTION * scale, WHITE_SIGMA),
        "assumed: a sensor's noise is 0.3 % of the response's range, within a factor 20",
    )


def correlated_amplitude(name: str, symbol: str, unit: str, scale: float) -> Parameter:
    """Standard deviation of the correlated noise."""
    _check_positive("range of the response", scale)
    return Parameter(
        name,
        symbol,
        unit,
        "standard deviation of correlated noise",
        LogNormal(CORRELATED_FRACTION * scale, CORRELATED_SIGMA),
        "assumed: drift and model error are 1 % of the response's range, within a factor 10",
    )


def offset_amplitude(unit: str, scale: float) -> Parameter:
    """Standard deviation of the zeros of records."""
    _check_positive("range of the response", scale)
    return Parameter(
        "sigma_offset",
        r"\sigma_\mathrm{off}",
        unit,
        "standard deviation of what records' zeros are off by",
        LogNormal(OFFSET_FRACTION * scale, CORRELATED_SIGMA),
        "assumed: a record's zero is known to 0.1 % of the response's range, within a factor 10",
    )


def correlation_length(name: str, symbol: str, coordinate_unit: str, span: float) -> Parameter:
    """Correlation time (or length) with 95 % of its prior below a tenth of the record.

    The bound is a hard one: under structural error the likelihood would rather have
    noise that lasts as long as the record, and lift whole curves off their data.
    """
    _check_positive("extent of the coordinate", span)
    shortest, tenth = SHORTEST_LENGTH * span, LENGTH_FRACTION * span
    longest = shortest * (tenth / shortest) ** (1.0 / 0.95)
    return Parameter(
        name,
        symbol,
        coordinate_unit,
        "correlation length of the noise along the coordinate",
        LogUniform(shortest, longest),
        "95 % below a tenth of the median record, lest noise take the model's slow processes",
    )


def _check_positive(what: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise UserError(
            f"noise priors: the {what} is {value}; a record needs at least two different values "
            "of coordinate and response"
        )
