"""A user's own model, tried on the records it is to be fitted to before anything is sampled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from deabayes.experiment import Experiment
from deabayes.prior.joint import Prior
from deabayes.systems import Draws, System

TRIAL_DRAWS = 3


def try_models(
    systems: Mapping[str, System],
    experiments: Sequence[Experiment],
    priors: Mapping[str, object],
    where: str,
) -> tuple[list[str], list[str]]:
    """Faults and warnings of candidates' responses at the median of their priors.

    A response without a row per draw and a column per point is a fault; one that is not
    finite there may be elsewhere, and is a warning. What cannot be computed at all is
    raised as it comes.
    """
    faults, warnings = [], []
    for candidate, system in systems.items():
        draws = _medians(system, priors)
        for each in experiments:
            place = f"{where}, {candidate}, {each.name}"
            with np.errstate(all="ignore"):
                found = np.asarray(
                    system.predict(each.excitation, each.coordinate, each.response_name, draws)
                )
            wanted = (TRIAL_DRAWS, each.coordinate.size)
            if found.shape != wanted:
                faults.append(
                    f"{place}: the model answers {TRIAL_DRAWS} draws at {wanted[1]} points with an "
                    f"array {found.shape}; return {wanted}, a row per draw"
                )
            elif not np.isfinite(found).all():
                warnings.append(
                    f"{place}: the model has no finite response at the median of its priors"
                )
    return faults, warnings


def _medians(system: System, priors: Mapping[str, object]) -> Draws:
    """Every parameter at its prior's median, (TRIAL_DRAWS,)."""
    prior = Prior.from_parameters(system.parameters(), priors, priors)
    theta = prior.to_parameters(np.zeros((TRIAL_DRAWS, len(prior.names))))
    return dict(zip(prior.names, np.ascontiguousarray(theta.T), strict=True))
