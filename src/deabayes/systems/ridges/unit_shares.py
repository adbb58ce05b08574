"""Which relaxation units of a posterior are parts of a sum that records show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.distributions import LogNormal, LogUniform
from deabayes.experiment import Experiment, FloatArray
from deabayes.prior.coordinates import log_normals
from deabayes.prior.joint import Prior
from deabayes.systems.ridges.nested_shares import NestedShares
from deabayes.systems.ridges.shares import Shares
from deabayes.systems.ridges.units import units_of

MANY = 4
"""Units of which any two may share what is seen of them while others are resolved."""


@dataclass(frozen=True)
class TooSlow:
    """ln(1 + tau / T) of ln tau, given ln T."""

    log_duration: float

    def __call__(self, log_times: FloatArray) -> FloatArray:
        return np.logaddexp(0.0, log_times - self.log_duration)


def shown_for(experiment: Experiment) -> float:
    """How slow a unit may be to be seen relaxing [s].

    As long as a record lasts, or the period of its lowest frequency; 0 where it knows of no time.
    """
    if experiment.coordinate_name == "time":
        return float(np.ptp(experiment.coordinate))
    if experiment.coordinate_name == "frequency":
        return 1.0 / float(np.min(experiment.coordinate))
    return 0.0


def unit_shares(
    prior: Prior,
    experiments: Sequence[Experiment],
    units_add: str | None,
    free: frozenset[int],
) -> list[Shares | NestedShares]:
    """One for each group of units that have one log-normal modulus each.

    From `MANY` on each unit is counted against all slower ones together.

    Parameters
    ----------
    units_add : see `System.units_add`.
    free : columns with priors of their own.
    """
    durations = [duration for each in experiments if (duration := shown_for(each))]
    if units_add is None or not durations:
        return []
    sign = 1.0 if units_add == "moduli" else -1.0
    found: list[Shares | NestedShares] = []
    for units in units_of(prior):
        times, *companions = (tuple(row.tolist()) for row in units.columns)
        logarithmic = isinstance(prior.parameters[times[0]].prior, LogUniform | LogNormal)
        if len(companions) != 1 or not logarithmic or not free.issuperset(times):
            continue
        normals = log_normals(prior, companions[0], free)
        if len(normals) == units.count:
            medians, sigmas = np.array([(p.median, p.sigma) for p in normals]).T
            hidden = TooSlow(float(np.log(max(durations))))
            kind = NestedShares if units.count >= MANY else Shares
            found.append(kind(times, companions[0], sign * np.log(medians), sign * sigmas, hidden))
    return found
