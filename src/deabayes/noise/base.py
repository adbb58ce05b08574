"""Interface of noise models, their sampling coordinates and their default priors."""

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
    """Probability model of the residuals (response - model) along one record's coordinate.

    Residuals are already divided by the record's scale, so `sigma_*` are in units
    of that scale. `weights` (N,) is 1/samples_averaged: the white noise of a mean
    of n raw samples has the variance sigma_white^2 / n. Correlated noise is taken
    as constant over an averaging window.

    All methods take residuals (W, N) and `draws` with this model's parameter
    names without the group's prefix, each (W,). The coordinate may turn back
    (loading, then unloading): correlation decays with the distance travelled.
    One draw never affects another's result.
    """

    name: ClassVar[str]
    diagnostic_only: ClassVar[bool] = False
    """Whether credible intervals are known to be too narrow for densely sampled records."""
    amplitude: ClassVar[str] = ""
    """Name of the standard deviation of the correlated part, if the model has one."""
    adding: ClassVar[tuple[str, ...]] = ()
    """Names of the standard deviations of the white and the correlated part, if it has both."""
    length: ClassVar[str] = ""
    """Name of the correlation length, if the model has one."""
    has_white: ClassVar[bool] = True
    """Whether two readings at the same coordinate may differ."""

    @abstractmethod
    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        """Parameters with default priors, named without the group's prefix.

        Parameters
        ----------
        unit : unit of the residuals (`1` when relative to a range).
        scale : typical range of the responses, in `unit` (1 when relative).
        span : typical extent of the coordinate, in `coordinate_unit`;
            correlation lengths have 95 % of their prior below a tenth of `span`.
        """

    def for_record(self, draws: Draws, correlated_scale: FloatArray | float) -> Draws:
        """Noise parameters in the unit of a record's residuals.

        Parameters
        ----------
        correlated_scale : unit of the correlated part's standard deviation, one for all draws or
            one per draw (W,): the record's range if it is a fraction of this range, else 1.
        """
        if not self.amplitude:
            return draws
        return {**draws, self.amplitude: draws[self.amplitude] * correlated_scale}

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
        """Variances of the correlated and the white part, (W,) each, averaged over the points."""

    @abstractmethod
    def spreads(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scale of a residual's correlated part alone (W, 1), and of the residual (W, N)."""

    @abstractmethod
    def cumulative(self, scores: FloatArray, draws: Draws) -> FloatArray:
        """Distribution function (W, N) of a residual, or its correlated part, over its scale."""


def variance(sigma: FloatArray) -> FloatArray:
    """sigma^2, contiguous (W,); NaN for a negative sigma."""
    sigma = np.asarray(sigma, dtype=float)
    return np.ascontiguousarray(np.where(sigma >= 0.0, sigma, np.nan) ** 2)


@dataclass(frozen=True)
class NoisePair:
    """White and correlated noise of a group: columns of z, with ln sigma = intercept + slope z.

    The intercepts include the logarithms of the factors of `noise_coordinates`.
    """

    columns: tuple[int, int]
    intercepts: tuple[float, float]
    slopes: tuple[float, float]

    def straighten(self, u: FloatArray) -> float:
        """Replace both columns by the log of total and ratio; return the log of the Jacobian."""
        white, correlated = self._logarithms(u)
        u[:, self.columns[0]] = 0.5 * np.logaddexp(2 * white, 2 * correlated)
        u[:, self.columns[1]] = correlated - white
        return float(np.log(self.slopes).sum())

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`."""
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
    noise: NoiseModel,
    prior: Prior,
    factors: Mapping[str, tuple[float, float]],
    free: frozenset[int],
) -> list[NoisePair]:
    """Return a pair for each noise group whose two amplitudes have log-normal priors.

    Parameters
    ----------
    factors : by group, the typical factors from the white and the correlated standard deviation
        to those of the residuals.
    free : columns to consider (see `prior_coordinates`).
    """
    pairs: list[NoisePair] = []
    for group, both in factors.items():
        columns = [prior.names.index(f"{group}.{name}") for name in noise.adding]
        normals = log_normals(prior, columns, free)
        if len(normals) == 2:
            white, correlated = (
                float(np.log(p.median * factor)) for p, factor in zip(normals, both, strict=True)
            )
            places, slopes = (columns[0], columns[1]), (normals[0].sigma, normals[1].sigma)
            pairs.append(NoisePair(places, (white, correlated), slopes))
    return pairs


WHITE_FRACTION, WHITE_SIGMA = 0.003, 1.5
CORRELATED_FRACTION, CORRELATED_SIGMA = 0.01, 1.2
OFFSET_FRACTION = 0.001
SHORTEST_LENGTH, LENGTH_FRACTION = 1e-4, 0.1


def white_amplitude(unit: str, scale: float) -> Parameter:
    """Standard deviation of the white noise of one raw sample."""
    _check_positive("range of the response", scale)
    return Parameter(
        "sigma_white",
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
    """Standard deviation of the zero offsets of records."""
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

    The upper bound is hard. With structural error, the likelihood would otherwise prefer
    noise as long as the record, and whole curves would shift away from their data.
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
