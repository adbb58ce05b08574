"""Noise models by name; a new one is a module and a line here."""

from __future__ import annotations

from deabayes.noise.ar1 import AutoRegressive
from deabayes.noise.base import NoiseModel
from deabayes.noise.matern32 import Matern32
from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck
from deabayes.noise.student_t import StudentT
from deabayes.noise.white import White

REGISTRY: dict[str, type[NoiseModel]] = {
    "ornstein_uhlenbeck": OrnsteinUhlenbeck,
    "white": White,
    "ar1": AutoRegressive,
    "matern32": Matern32,
    "student_t": StudentT,
}
