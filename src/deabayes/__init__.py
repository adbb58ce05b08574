"""Bayesian characterisation of dielectric elastomer actuators.

Examples
--------
>>> import deabayes
>>> post = deabayes.open_posterior("results/tubular/voigt_kelvin_2/posterior.nc")  # doctest: +SKIP
>>> post.summary()  # doctest: +SKIP
"""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from deabayes.faults import PredictionWarning, UserError

if TYPE_CHECKING:
    from deabayes.api import Posterior, open_posterior
    from deabayes.own_models.loading import load_models
    from deabayes.prediction.simulate import simulate

__version__ = version("deabayes")
__all__ = [
    "Posterior",
    "PredictionWarning",
    "UserError",
    "load_models",
    "open_posterior",
    "simulate",
]


def __getattr__(name: str) -> Any:
    # Imported on first use: opening a posterior must not load numba or scipy.
    if name in ("Posterior", "open_posterior"):
        from deabayes import api

        return getattr(api, name)
    if name == "load_models":
        from deabayes.own_models.loading import load_models

        return load_models
    if name == "simulate":
        from deabayes.prediction.simulate import simulate

        return simulate
    raise AttributeError(f"module 'deabayes' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
