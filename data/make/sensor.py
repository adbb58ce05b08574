"""A displacement sensor with the faults real ones have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray


@dataclass(frozen=True)
class Sensor:
    """What a sensor adds to the quantity it measures.

    Attributes
    ----------
    delay : the reading at t is the quantity at t - delay [s].
    sigma_white, sigma_ou : sd of the white and of the Ornstein-Uhlenbeck noise.
    tau_ou : correlation time of the latter [s].
    offset : sd of the reading at rest.
    drift : sd of its drift per second.
    resolution : readings are multiples of it.
    """

    delay: float
    sigma_white: float
    sigma_ou: float
    tau_ou: float
    offset: float
    drift: float
    resolution: float

    def read(
        self,
        quantity: Callable[[FloatArray], FloatArray],
        time: FloatArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Readings at evenly spaced times (N,) of a quantity given as a function of time."""
        reading = quantity(time - self.delay)
        reading = reading + self.offset * rng.standard_normal()
        reading = reading + self.drift * rng.standard_normal() * (time - time[0])
        reading = reading + self.sigma_ou * ornstein_uhlenbeck(time, self.tau_ou, rng)
        reading = reading + self.sigma_white * rng.standard_normal(time.size)
        return quantised(reading, self.resolution)


def ornstein_uhlenbeck(time: FloatArray, tau: float, rng: np.random.Generator) -> FloatArray:
    """One path of unit variance, stationary from the first of the times (N,) on."""
    decay = np.exp(-np.diff(time) / tau)
    shocks = rng.standard_normal(time.size)
    path = np.empty(time.size)
    path[0] = shocks[0]
    for k in range(1, time.size):
        path[k] = decay[k - 1] * path[k - 1] + np.sqrt(1.0 - decay[k - 1] ** 2) * shocks[k]
    return path


def quantised(values: FloatArray, resolution: float) -> FloatArray:
    """Values rounded to multiples of the resolution."""
    return resolution * np.round(values / resolution)
