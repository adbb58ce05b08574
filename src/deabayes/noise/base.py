"""What every noise model offers: a density and samples from the same law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.parameter import Parameter

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
