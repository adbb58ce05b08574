"""Univariate priors by name; a new one is a module `distributions/<name>.py` and a line here."""

from __future__ import annotations

from deabayes.experiment import FloatArray
from deabayes.prior.distributions.base import Distribution, format_number
from deabayes.prior.distributions.halfnormal import HalfNormal
from deabayes.prior.distributions.lognormal import LogNormal
from deabayes.prior.distributions.loguniform import LogUniform
from deabayes.prior.distributions.normal import Normal
from deabayes.prior.distributions.truncated_normal import TruncatedNormal
from deabayes.prior.distributions.uniform import Uniform

__all__ = [
    "REGISTRY",
    "Distribution",
    "FloatArray",
    "HalfNormal",
    "LogNormal",
    "LogUniform",
    "Normal",
    "TruncatedNormal",
    "Uniform",
    "format_number",
]

REGISTRY: dict[str, type[Distribution]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
    "loguniform": LogUniform,
    "halfnormal": HalfNormal,
    "truncated_normal": TruncatedNormal,
}
"""Distribution as a config names it -> its class in the module of the same name."""
