"""Ornstein-Uhlenbeck plus white noise, the default noise model."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import Draws
from deabayes.noise.gaussian import Kernels, StateSpaceNoise, kernel_arrays


class OrnsteinUhlenbeck(StateSpaceNoise):
    """cov(r_j, r_k) = sigma_ou^2 exp(-|t_j - t_k| / tau_ou) + sigma_white^2 w_k delta_jk.

    Uhlenbeck & Ornstein 1930 (10.1103/PhysRev.36.823), filtered exactly on any
    grid in O(N). The correlated part represents drift and model error, the
    white part the noise of the sensor.
    """

    name = "ornstein_uhlenbeck"
    adding: ClassVar[tuple[str, ...]] = ("sigma_white", "sigma_ou")
    amplitude, length, subscript = "sigma_ou", "tau_ou", "OU"

    @staticmethod
    def kernels() -> Kernels:
        from deabayes.noise.kalman import filter_exponential, simulate_exponential

        return filter_exponential, simulate_exponential

    def log_prob(
        self, residuals: FloatArray, coordinate: FloatArray, weights: FloatArray, draws: Draws
    ) -> FloatArray:
        from deabayes.noise.kalman import log_prob

        total = log_prob(*kernel_arrays(residuals, coordinate, weights), *self.laws(draws))
        return np.where(np.isfinite(total), total, -np.inf)
