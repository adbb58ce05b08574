"""What every noise model offers: a density and samples from the same law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.parameter import Parameter


class NoiseModel(ABC):
    """The law of (response - model) along one record's coordinate.

    Residuals come already divided by the record's scale, so `sigma_*` are in
    units of that scale. `weights` is 1/samples_averaged (N,): the variance of a
    mean of n raw samples' white noise is sigma_white^2 / n.

    All methods take residuals (W, N) and `draws` with this model's parameter
    names without the group's prefix, each (W,).
    """

    name: ClassVar[str]
    diagnostic_only: ClassVar[bool] = False

    @abstractmethod
    def parameters(self, unit: str, scale: float, span: float) -> tuple[Parameter, ...]:
        """Parameters, unprefixed, with default priors.

        Parameters
        ----------
        unit : unit of the residuals (`1` when relative to a range).
        scale : typical range of the responses, in `unit` (1 when relative).
        span : typical extent of the coordinate; correlation lengths have
            95 % of their prior below a tenth of it.
        """

    @abstractmethod
    def pointwise_log_prob(
        self,
        residuals: FloatArray,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Mapping[str, FloatArray],
    ) -> FloatArray:
        """log p(r_k | r_1..k-1), (W, N); rows with NaN residuals give NaN."""

    @abstractmethod
    def log_prob(
        self,
        residuals: FloatArray,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Mapping[str, FloatArray],
    ) -> FloatArray:
        """log p(r), (W,): the sum of the pointwise terms, -inf where NaN."""

    @abstractmethod
    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Mapping[str, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """One sample per draw: (discrepancy (W, N), white (W, N)); their sum is the residual."""
