"""Gaussian noise models, defined by the innovations of a filter and their variances."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws, NoiseModel

LOG_2PI = float(np.log(2.0 * np.pi))


class GaussianNoise(NoiseModel):
    """A Gaussian law given by one-step predictions r_k | r_1..k-1 ~ N(m_k, S_k)."""

    @abstractmethod
    def filtered(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        """Innovations r_k - m_k and their variances S_k, both (W, N)."""

    def pointwise_log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        innovation, variance = self.filtered(residuals, coordinate, weights, draws)
        with np.errstate(all="ignore"):
            log_prob = -0.5 * (LOG_2PI + np.log(variance) + innovation**2 / variance)
        return _whole_rows(log_prob, residuals)

    def innovations(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        innovation, variance = self.filtered(residuals, coordinate, weights, draws)
        with np.errstate(all="ignore"):
            return _whole_rows(innovation / np.sqrt(variance), residuals)

    def spreads(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        correlated, white = (part[:, None] for part in self.variances(draws, np.ones(1)))
        return np.sqrt(correlated), np.sqrt(correlated + white * weights)

    def cumulative(self, scores: FloatArray, draws: Draws) -> FloatArray:
        from scipy.special import ndtr

        return np.asarray(ndtr(scores))


def white_sample(
    rng: np.random.Generator, weights: FloatArray, sigma_white: FloatArray
) -> FloatArray:
    """Independent N(0, sigma_white^2 w_k), (W, N)."""
    sigma_white = np.asarray(sigma_white, dtype=float)
    normal = rng.standard_normal((sigma_white.size, weights.size))
    return sigma_white[:, None] * np.sqrt(weights) * normal


def _whole_rows(values: FloatArray, residuals: FloatArray) -> FloatArray:
    """Set rows to NaN if their residuals are not all finite."""
    values[~np.all(np.isfinite(residuals), axis=1)] = np.nan
    return values
