"""Ornstein-Uhlenbeck plus white noise, the default noise model."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import (
    Draws,
    contiguous,
    correlated_amplitude,
    correlation_length,
    rate,
    variance,
    white_amplitude,
)
from deabayes.noise.gaussian import GaussianNoise, white_sample
from deabayes.prior.parameter import Parameter


class OrnsteinUhlenbeck(GaussianNoise):
    """cov(r_j, r_k) = sigma_ou^2 exp(-|t_j - t_k| / tau_ou) + sigma_white^2 w_k delta_jk.

    Uhlenbeck & Ornstein 1930 (10.1103/PhysRev.36.823), filtered exactly on any
    grid in O(N). The correlated part represents drift and model error, the
    white part the noise of the sensor.
    """

    name = "ornstein_uhlenbeck"
    adding = ("sigma_white", "sigma_ou")
    length = "tau_ou"

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        return (
            white_amplitude(unit, scale),
            correlated_amplitude("sigma_ou", r"\sigma_\mathrm{OU}", unit, scale),
            correlation_length("tau_ou", r"\tau_\mathrm{OU}", coordinate_unit, span),
        )

    def _laws(self, draws: Draws) -> tuple[FloatArray, FloatArray, FloatArray]:
        return (
            variance(draws["sigma_white"]),
            variance(draws["sigma_ou"]),
            rate(draws["tau_ou"]),
        )

    def filtered(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        from deabayes.noise.kalman import distances, filter_exponential

        steps = distances(contiguous(coordinate))
        return filter_exponential(
            contiguous(residuals), steps, contiguous(weights), *self._laws(draws)
        )

    def log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        from deabayes.noise.kalman import distances, log_prob

        steps = distances(contiguous(coordinate))
        total = log_prob(contiguous(residuals), steps, contiguous(weights), *self._laws(draws))
        return np.where(np.isfinite(total), total, -np.inf)

    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        from deabayes.noise.kalman import distances, simulate_exponential

        white, correlated, rates = self._laws(draws)
        normal = rng.standard_normal((correlated.size, len(coordinate)))
        steps = distances(contiguous(coordinate))
        discrepancy = simulate_exponential(normal, steps, correlated, rates)
        return discrepancy, white_sample(rng, weights, np.sqrt(white))

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        return variance(draws["sigma_ou"]), variance(draws["sigma_white"]) * np.mean(weights)
