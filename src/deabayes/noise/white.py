"""White noise: for diagnosis only, because residuals of dense records are correlated."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws, variance, white_amplitude
from deabayes.noise.gaussian import LOG_2PI, GaussianNoise, white_sample
from deabayes.prior.parameter import Parameter


class White(GaussianNoise):
    """r_k ~ N(0, sigma_white^2 w_k), independent.

    The faster a record is sampled, the more its credible intervals are too narrow,
    without limit. Use this model to see the effect of correlation, not for reports.
    """

    name = "white"
    diagnostic_only = True

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        return (white_amplitude(unit, scale),)

    def filtered(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        return np.array(residuals), variance(draws["sigma_white"])[:, None] * weights

    def log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        with np.errstate(all="ignore"):
            squares = np.einsum("wn,wn,n->w", residuals, residuals, 1.0 / weights)
            white = variance(draws["sigma_white"])
            total = -0.5 * (squares / white + weights.size * (LOG_2PI + np.log(white)))
            total -= 0.5 * np.log(weights).sum()
        return np.where(np.isfinite(total), total, -np.inf)

    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        white = white_sample(rng, weights, draws["sigma_white"])
        return np.zeros_like(white), white

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        white = variance(draws["sigma_white"]) * np.mean(weights)
        return np.zeros_like(white), white
