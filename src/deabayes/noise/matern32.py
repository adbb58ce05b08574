"""Matern-3/2 plus white noise: correlated noise that is smooth."""

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


class Matern32(GaussianNoise):
    """cov(r_j, r_k) = sigma_matern^2 (1 + x) exp(-x) + sigma_white^2 w_k delta_jk.

    x = sqrt(3) |t_j - t_k| / tau_matern (Rasmussen & Williams 2006, eq. 4.17), as
    a state space of two dimensions (Hartikainen & Sarkka 2010,
    10.1109/MLSP.2010.5589113).
    """

    name = "matern32"
    adding = ("sigma_white", "sigma_matern")
    length = "tau_matern"

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        return (
            white_amplitude(unit, scale),
            correlated_amplitude("sigma_matern", r"\sigma_\mathrm{M}", unit, scale),
            correlation_length("tau_matern", r"\tau_\mathrm{M}", coordinate_unit, span),
        )

    def _laws(self, draws: Draws) -> tuple[FloatArray, FloatArray, FloatArray]:
        return (
            variance(draws["sigma_white"]),
            variance(draws["sigma_matern"]),
            np.sqrt(3.0) * rate(draws["tau_matern"]),
        )

    def filtered(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        from deabayes.noise.kalman import distances, filter_matern32

        steps = distances(contiguous(coordinate))
        return filter_matern32(
            contiguous(residuals), steps, contiguous(weights), *self._laws(draws)
        )

    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        from deabayes.noise.kalman import distances, simulate_matern32

        white, correlated, rates = self._laws(draws)
        normal = rng.standard_normal((correlated.size, len(coordinate), 2))
        discrepancy = simulate_matern32(
            normal, distances(contiguous(coordinate)), correlated, rates
        )
        return discrepancy, white_sample(rng, weights, np.sqrt(white))

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        return variance(draws["sigma_matern"]), variance(draws["sigma_white"]) * np.mean(weights)
