"""Noise models by name; a new one is a module `noise/<name>.py` and a line here."""

from __future__ import annotations

from deabayes.noise.base import NoiseModel
from deabayes.registry import load

REGISTRY: dict[str, type[NoiseModel]] = load(
    __name__,
    {
        "ornstein_uhlenbeck": "OrnsteinUhlenbeck",
        "ornstein_uhlenbeck_offset": "OrnsteinUhlenbeckOffset",
        "white": "White",
        "ar1": "AutoRegressive",
        "matern32": "Matern32",
        "student_t": "StudentT",
    },
)
"""Noise model -> its class in the module of the same name."""
