"""Gaussian noise models: any, and correlated noise that a Kalman filter follows."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import (
    Draws,
    NoiseModel,
    correlated_amplitude,
    correlation_length,
    variance,
    white_amplitude,
)
from deabayes.prior.parameter import Parameter

Kernels = tuple[Callable[..., tuple[FloatArray, FloatArray]], Callable[..., FloatArray]]
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
        return whole_rows(log_prob, residuals)

    def innovations(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        innovation, variance = self.filtered(residuals, coordinate, weights, draws)
        with np.errstate(all="ignore"):
            return whole_rows(innovation / np.sqrt(variance), residuals)

    def spreads(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        correlated, white = (part[:, None] for part in self.variances(draws, np.ones(1)))
        return np.sqrt(correlated), np.sqrt(correlated + white * weights)

    def cumulative(self, scores: FloatArray, draws: Draws) -> FloatArray:
        from scipy.special import ndtr

        return np.asarray(ndtr(scores))


class StateSpaceNoise(GaussianNoise):
    """Correlated noise that is a stationary Markov process, plus white noise.

    cov(r_j, r_k) = sigma^2 rho(rate |t_j - t_k|) + sigma_white^2 w_k delta_jk. A subclass names
    its parameters and gives the compiled functions of its correlation function rho.
    """

    subscript: ClassVar[str]
    """Subscript of the symbols of amplitude and length."""
    rate_factor: ClassVar[float] = 1.0
    """The rate is this factor over the correlation length."""
    states: ClassVar[int] = 1
    """Size of the process's state."""

    @staticmethod
    @abstractmethod
    def kernels() -> Kernels:
        """Filter and simulation from `noise.kalman`, which loads numba on first use."""

    def parameters(
        self, unit: str, scale: float, span: float, coordinate_unit: str = "s"
    ) -> tuple[Parameter, ...]:
        sigma, tau = (rf"\{s}_\mathrm{{{self.subscript}}}" for s in ("sigma", "tau"))
        correlated = (
            correlated_amplitude(self.amplitude, sigma, unit, scale),
            correlation_length(self.length, tau, coordinate_unit, span),
        )
        return (white_amplitude(unit, scale), *correlated) if self.has_white else correlated

    def laws(self, draws: Draws) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Variances of the white and the correlated part, and the rate, (W,) each."""
        correlated, length = variance(draws[self.amplitude]), draws[self.length]
        white = variance(draws["sigma_white"]) if self.has_white else np.zeros_like(correlated)
        rates = self.rate_factor * (1.0 / np.where(np.asarray(length) > 0.0, length, np.nan))
        return white, correlated, np.ascontiguousarray(rates)

    def filtered(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> tuple[FloatArray, FloatArray]:
        filter_record, _ = self.kernels()
        return filter_record(*kernel_arrays(residuals, coordinate, weights), *self.laws(draws))

    def sample(
        self,
        rng: np.random.Generator,
        coordinate: FloatArray,
        weights: FloatArray,
        draws: Draws,
    ) -> tuple[FloatArray, FloatArray]:
        _, simulate = self.kernels()
        white, correlated, rates = self.laws(draws)
        normal = rng.standard_normal((correlated.size, len(coordinate), self.states))
        _, distances, _ = kernel_arrays(normal, coordinate, weights)
        discrepancy = simulate(normal, distances, correlated, rates)
        return discrepancy, white_sample(rng, weights, np.sqrt(white))

    def variances(self, draws: Draws, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        white, correlated, _ = self.laws(draws)
        return correlated, white * np.mean(weights)


def kernel_arrays(
    residuals: FloatArray, coordinate: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals, distances between points and weights as kernels need them: float64, C order."""
    from deabayes.noise.kalman import distances

    arrays = (np.ascontiguousarray(a, dtype=np.float64) for a in (residuals, coordinate, weights))
    residuals, coordinate, weights = arrays
    return residuals, distances(coordinate), weights


def white_sample(
    rng: np.random.Generator, weights: FloatArray, sigma_white: FloatArray
) -> FloatArray:
    """Independent N(0, sigma_white^2 w_k), (W, N)."""
    sigma_white = np.asarray(sigma_white, dtype=float)
    normal = rng.standard_normal((sigma_white.size, weights.size))
    return sigma_white[:, None] * np.sqrt(weights) * normal


def whole_rows(values: FloatArray, residuals: FloatArray) -> FloatArray:
    """Set rows to NaN if their residuals are not all finite."""
    values[~np.all(np.isfinite(residuals), axis=1)] = np.nan
    return values
