"""How strongly neighbouring points of a simulated membrane correlate by its true noise.

Correlation times are drawn from the noise prior, over decades. Where they are shorter than the
spacing of points noise is as good as independent, and nothing is lost by fitting it as such; what
that costs is to be seen in the other specimens. They are told apart by the truth alone, which
leaves coverage of the right model what it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from deabayes.experiment import FloatArray
from tests.validation.membrane_recovery import specimen
from tests.validation.membrane_worlds import membrane
from tests.validation.worlds import OU

CORRELATED = 0.2


def correlated(order: int, replicates: pd.Series[int]) -> pd.Series[bool]:
    """Which specimens' neighbouring points correlate, sampled as usual, by `CORRELATED` or more."""
    world = membrane()
    target = world.target(order, OU)
    times = world.records[0].coordinate
    found = [
        lag_one(specimen(world, target, order, int(index))[0].truth, times) >= CORRELATED
        for index in replicates
    ]
    return pd.Series(found, index=replicates.index)


def lag_one(truth: Mapping[str, FloatArray], times: FloatArray) -> float:
    """Mean correlation of neighbouring residuals.

    That of Ornstein-Uhlenbeck and white noise is, a time d apart,
    sigma_ou^2 exp(-d / tau_ou) / (sigma_ou^2 + sigma_white^2).
    """
    correlated, white, time = (
        float(truth[f"step.{name}"][0]) for name in ("sigma_ou", "sigma_white", "tau_ou")
    )
    share = correlated**2 / (correlated**2 + white**2)
    return float(share * np.exp(-np.diff(times) / time).mean())
