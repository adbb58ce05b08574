"""Dense covariance matrices of the Gaussian noise models."""

import numpy as np

GAUSSIAN = ["white", "ornstein_uhlenbeck", "ornstein_uhlenbeck_offset", "ar1", "matern32"]
RELATIVE = 1e-8
"""How near a density must be to that of the dense covariance."""


def covariance(name, coordinate, weights, draw):
    """The dense covariance matrix of one draw."""
    distance = np.abs(coordinate[:, None] - coordinate[None, :])
    white = np.diag(draw.get("sigma_white", 0.0) ** 2 * weights)
    if name == "white":
        return white
    if name == "matern32":
        x = np.sqrt(3.0) * distance / draw["tau_matern"]
        return draw["sigma_matern"] ** 2 * (1.0 + x) * np.exp(-x) + white
    if name == "ornstein_uhlenbeck_offset":
        zero = draw["sigma_offset"] ** 2
        return zero + covariance("ornstein_uhlenbeck", coordinate, weights, draw)
    suffix = {"ornstein_uhlenbeck": "ou", "ar1": "ar1"}[name]
    correlation = np.exp(-distance / draw[f"tau_{suffix}"])
    return draw[f"sigma_{suffix}"] ** 2 * correlation + white
