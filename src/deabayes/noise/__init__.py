"""Noise models by name. To add a model, write a module `noise/<name>.py` and add it here."""

from __future__ import annotations

from deabayes.noise.ar1 import AutoRegressive
from deabayes.noise.base import NoiseModel
from deabayes.noise.matern32 import Matern32
from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck
from deabayes.noise.ornstein_uhlenbeck_offset import OrnsteinUhlenbeckOffset
from deabayes.noise.student_t import StudentT
from deabayes.noise.white import White

REGISTRY: dict[str, type[NoiseModel]] = {
    model.name: model
    for model in (
        OrnsteinUhlenbeck,
        OrnsteinUhlenbeckOffset,
        White,
        AutoRegressive,
        Matern32,
        StudentT,
    )
}
"""Noise model -> its class."""
