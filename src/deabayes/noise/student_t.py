"""Independent Student-t noise: records with outliers, for diagnosis only."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws, NoiseModel, variance, white_amplitude
from deabayes.noise.gaussian import whole_rows
from deabayes.prior.distributions import LogNormal
from deabayes.prior.parameter import Parameter


class StudentT(NoiseModel):
    """r_k = sigma_white sqrt(w_k) t_k, t_k independent Student-t of `degrees_of_freedom`.

    sigma_white is the scale, not the standard deviation. The mean of n raw
    samples is taken to have the same degrees of freedom, which exaggerates its
    tails. Like white noise, it has no correlation.
    """

    name = "student_t"
    diagnostic_only = True

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        return (
            white_amplitude(unit, scale),
            Parameter(
                "degrees_of_freedom",
                r"\nu",
                "1",
                "degrees of freedom of Student-t noise; large is Gaussian",
                LogNormal(10.0, 0.8),
                "assumed: from outliers in every record (3) to nearly Gaussian (40)",
            ),
        )

    def _scaled(
        self, residuals: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals over their scale, the scale (W, N), and the degrees of freedom (W, 1)."""
        with np.errstate(all="ignore"):
            scale = np.sqrt(variance(draws["sigma_white"])[:, None] * weights)
            scaled = residuals / scale
        freedom = np.asarray(draws["degrees_of_freedom"], dtype=float)[:, None]
        return whole_rows(scaled, residuals), scale, np.where(freedom > 0.0, freedom, np.nan)

    def pointwise_log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        from scipy.special import betaln

        scaled, scale, freedom = self._scaled(residuals, weights, draws)
        with np.errstate(all="ignore"):
            constant = -betaln(0.5, 0.5 * freedom) - 0.5 * np.log(freedom) - np.log(scale)
            return constant - 0.5 * (freedom + 1.0) * np.log1p(scaled**2 / freedom)

    def innovations(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        from scipy.special import ndtri, stdtr

        scaled, _, freedom = self._scaled(residuals, weights, draws)
        smaller_tail = np.maximum(stdtr(freedom, -np.abs(scaled)), np.finfo(float).tiny)
        return -np.sign(scaled) * ndtri(smaller_tail)

    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        sigma = np.asarray(draws["sigma_white"], dtype=float)[:, None]
        freedom = np.asarray(draws["degrees_of_freedom"], dtype=float)[:, None]
        student = rng.standard_t(freedom, (sigma.shape[0], len(coordinate)))
        return np.zeros_like(student), sigma * np.sqrt(weights) * student

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        freedom = np.asarray(draws["degrees_of_freedom"], dtype=float)
        with np.errstate(all="ignore"):
            wider = np.where(freedom > 2.0, freedom / (freedom - 2.0), np.inf)
        white = variance(draws["sigma_white"]) * np.mean(weights) * wider
        return np.zeros_like(white), white

    def spreads(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        sigma = np.sqrt(variance(draws["sigma_white"]))[:, None]
        return np.zeros_like(sigma), sigma * np.sqrt(weights)

    def cumulative(self, scores: FloatArray, draws: Draws) -> FloatArray:
        from scipy.special import stdtr

        freedom = np.asarray(draws["degrees_of_freedom"], dtype=float)[:, None]
        return np.asarray(stdtr(freedom, scores))
