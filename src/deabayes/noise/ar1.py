"""First-order autoregressive noise without a white part."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws, correlated_amplitude, correlation_length, variance
from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck
from deabayes.prior.parameter import Parameter


class AutoRegressive(OrnsteinUhlenbeck):
    """cov(r_j, r_k) = sigma_ar1^2 exp(-|t_j - t_k| / tau_ar1), on any grid.

    On a grid of spacing d this is AR(1) with coefficient exp(-d / tau_ar1).
    Averaging does not shrink correlated noise, so the weights have no effect.
    """

    name = "ar1"
    length = "tau_ar1"
    has_white = False

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        return (
            correlated_amplitude("sigma_ar1", r"\sigma_\mathrm{AR}", unit, scale),
            correlation_length("tau_ar1", r"\tau_\mathrm{AR}", coordinate_unit, span),
        )

    def _laws(self, draws: Draws) -> tuple[FloatArray, FloatArray, FloatArray]:
        sigma = np.asarray(draws["sigma_ar1"], dtype=float)
        return super()._laws(
            {
                "sigma_white": np.zeros_like(sigma),
                "sigma_ou": sigma,
                "tau_ou": draws["tau_ar1"],
            }
        )

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        correlated = variance(draws["sigma_ar1"])
        return correlated, np.zeros_like(correlated)
