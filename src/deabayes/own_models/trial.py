"""Try a user's own model on the records to be fitted, before any sampling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.own_models.checks import name_faults, unit_faults
from deabayes.prior.joint import Prior
from deabayes.systems import Derived, Draws, Simulator, System

TRIAL_DRAWS = 3
SAME = 1e-3
"""Largest difference between two responses to one draw, as a share of the largest value. Models
that integrate all draws with common steps differ by their tolerance."""


def try_models(
    systems: Mapping[str, System],
    experiments: Sequence[Experiment],
    priors: Mapping[str, object],
    where: str,
) -> tuple[list[str], list[str]]:
    """Return faults and warnings of candidates' responses to a few draws of their priors.

    A response must be an array of real numbers with one row per draw and one column per point.
    It must not depend on when it is computed, nor on the other draws computed with it. A
    response that is not finite at the median of the priors, the first draw, may be finite
    elsewhere and is only a warning. Errors of the model are passed on.
    """
    faults: dict[str, str] = {}
    warnings = []
    for candidate, system in systems.items():
        draws = _trial_draws(system, priors)
        for fault in _derived_faults(system, draws):
            faults.setdefault(fault, f"{where}, {candidate}: {fault}")
        for each in experiments:
            place = f"{where}, {candidate}, {each.name}"
            with np.errstate(all="ignore"):
                fault, at_median = _try_on(system, each, draws)
            if fault:
                faults.setdefault(fault, f"{place}: {fault}")
            elif not np.isfinite(at_median).all():
                warnings.append(
                    f"{place}: the model has no finite response at the median of its priors"
                )
    return list(faults.values()), warnings


def _trial_draws(system: System, priors: Mapping[str, object]) -> Draws:
    """Draws (TRIAL_DRAWS,) of every parameter; the first is the median of its prior."""
    prior = Prior.from_parameters(system.parameters(), priors, priors)
    z = np.random.default_rng(0).standard_normal((TRIAL_DRAWS, len(prior.names)))
    z[0] = 0.0
    theta = prior.to_parameters(z)
    return dict(zip(prior.names, np.ascontiguousarray(theta.T), strict=True))


def _try_on(system: System, experiment: Experiment, draws: Draws) -> tuple[str, FloatArray]:
    """Return the response's fault (empty if none), and the response to the first draw."""
    simulate = system.simulator(
        experiment.excitation, experiment.coordinate, experiment.response_name
    )
    if not callable(simulate):
        return f"simulator gives {simulate!r:.80}; return a function of draws", np.empty(0)
    given = {name: values.copy() for name, values in draws.items()}
    found: Any = simulate(given)
    fault = _kind_fault(found, experiment.coordinate.size) or _changed(given, draws)
    return (fault, np.empty(0)) if fault else (_repeat_fault(simulate, draws, found), found[0])


def _kind_fault(found: Any, points: int) -> str:
    """Fault if a response is no array of real numbers of the right shape."""
    if not isinstance(found, np.ndarray):
        return f"the response is a {type(found).__name__}; return a numpy array"
    if found.dtype.kind not in "fiu":
        return f"the response has numbers of type {found.dtype}; return real numbers"
    if found.shape != (TRIAL_DRAWS, points):
        return (
            f"the response to {TRIAL_DRAWS} draws at {points} points has shape {found.shape}; "
            f"return {(TRIAL_DRAWS, points)}, one row per draw"
        )
    return ""


def _changed(given: Draws, draws: Draws) -> str:
    changed = [n for n in draws if n not in given or not np.array_equal(given[n], draws[n])]
    named = ", ".join(changed)
    return f"the model changes the draws ({named}); change a copy instead" if changed else ""


def _repeat_fault(simulate: Simulator, draws: Draws, found: FloatArray) -> str:
    """Fault if the same draws give another response when repeated, or one by one."""
    kept = found.copy()
    again = simulate({name: values.copy() for name, values in draws.items()})
    if not _same(again, kept):
        return "the same draws give another response when repeated; remove what is random or kept"
    for row in range(TRIAL_DRAWS):
        alone = simulate({name: values[row : row + 1].copy() for name, values in draws.items()})
        if not _same(alone, kept[row : row + 1]):
            return (
                "the response to a draw depends on the other draws; compute each row from its own "
                'draw, for example with draws["NAME"][:, None]'
            )
    return ""


def _same(first: FloatArray, second: FloatArray) -> bool:
    size = np.max(np.abs(second), initial=0.0, where=np.isfinite(second))
    return np.shape(first) == np.shape(second) and bool(
        np.isclose(first, second, rtol=0.0, atol=SAME * size, equal_nan=True).all()
    )


def _derived_faults(system: System, draws: Draws) -> list[str]:
    """Faults of the quantities that the system derives from draws."""
    with np.errstate(all="ignore"):
        found: Any = system.derived(draws)
    if not isinstance(found, Mapping):
        return [f"derived gives {found!r:.80}; return a mapping of names to Derived"]
    faults = name_faults("derived", list(found), (*draws, *system.excitations, *system.responses))
    for name, each in found.items():
        if not isinstance(each, Derived):
            faults.append(
                f"derived {name!r} is {each!r:.80}; give a deabayes.systems.Derived with symbol, "
                "unit, description and values"
            )
            continue
        faults += unit_faults("derived", {str(name): each.unit})
        values = np.asarray(each.values)
        if values.shape != (TRIAL_DRAWS,) or values.dtype.kind not in "fiu":
            faults.append(
                f"derived {name!r} has values {values.shape} of type {values.dtype}; return "
                f"{(TRIAL_DRAWS,)} real numbers, one per draw"
            )
    return faults
