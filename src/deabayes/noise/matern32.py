"""Matern-3/2 plus white noise: correlated noise that is smooth."""

from __future__ import annotations

from math import sqrt

from deabayes.noise.gaussian import Kernels, StateSpaceNoise


class Matern32(StateSpaceNoise):
    """cov(r_j, r_k) = sigma_matern^2 (1 + x) exp(-x) + sigma_white^2 w_k delta_jk.

    x = sqrt(3) |t_j - t_k| / tau_matern (Rasmussen & Williams 2006, eq. 4.17), as
    a state space of two dimensions (Hartikainen & Sarkka 2010,
    10.1109/MLSP.2010.5589113).
    """

    name = "matern32"
    adding = ("sigma_white", "sigma_matern")
    amplitude, length, subscript = "sigma_matern", "tau_matern", "M"
    rate_factor, states = sqrt(3.0), 2

    @staticmethod
    def kernels() -> Kernels:
        from deabayes.noise.kalman import filter_matern32, simulate_matern32

        return filter_matern32, simulate_matern32
