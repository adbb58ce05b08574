"""Masses and circuit of a tubular actuator, from posteriors or from stated values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from deabayes.experiment import FloatArray, Specimen
from deabayes.papers.base import StudyContext, labels
from deabayes.posteriors.fitted import Fitted
from deabayes.systems.specimen_quantities import uncertain_quantities
from deabayes.systems.tubular.base import CIRCUIT_SYMBOLS, TubularBase
from deabayes.systems.tubular.circuit import Circuit

Labels = dict[str, object]
STATED_DRAWS = 4000
STATED: Mapping[str, object] = {"candidate": "specimen.yaml", "order": "", "converged": True}
"""First columns of a row that rests on stated values only."""


def circuits(context: StudyContext, rng: np.random.Generator) -> list[tuple[Labels, Circuit]]:
    """Draws of R_S, R_L and C of every candidate with a circuit, else of the stated values.

    A candidate that is predicted with a circuit (`predict_with`) counts as one with a circuit.
    The list is empty if no candidate has a circuit and the specimen states none.
    """
    found: list[tuple[Labels, Circuit]] = []
    for name, fitted in context.candidates.items():
        system = having(fitted, "circuit")
        if system is not None:
            found.append((sourced(name, fitted, system), system.circuit_of(fitted.draws)))
    if found or not stated(context.specimen, CIRCUIT_SYMBOLS):
        return found
    drawn = prior_draws(context.specimen, CIRCUIT_SYMBOLS, rng)
    return [(dict(STATED), Circuit(*drawn.values()))]


def having(fitted: Fitted, part: str) -> TubularBase | None:
    """Return the candidate's system that has the `part` `circuit` or `inertia`, or None.

    The fitted system comes first, then the systems used for prediction.
    """
    for system in (fitted.system, *fitted.predicts_with.values()):
        if isinstance(system, TubularBase) and getattr(system, part):
            return system
    return None


def sourced(name: str, fitted: Fitted, system: TubularBase) -> Labels:
    """First columns of a row; a note says if the part was not fitted and follows its prior."""
    first = labels(name, fitted)
    return (
        first if system is fitted.system else first | {"candidate": f"{name} (prior, not fitted)"}
    )


def stated(specimen: Specimen, names: Iterable[str]) -> bool:
    """Whether specimen.yaml gives all of these quantities."""
    return set(names) <= set(specimen.quantities)


def prior_draws(
    specimen: Specimen, names: Iterable[str], rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Draws (S,) of stated quantities: random if a standard deviation is stated, else constant."""
    given = {name: specimen.quantities[name] for name in names}
    units = {name: quantity.unit for name, quantity in given.items()}
    uncertain = uncertain_quantities(specimen, {name: name for name in given}, units)
    drawn = {name: np.full(STATED_DRAWS, quantity.value) for name, quantity in given.items()}
    for parameter in uncertain:
        scores = rng.standard_normal(STATED_DRAWS)
        drawn[parameter.name] = np.asarray(parameter.prior.from_normal(scores))
    return drawn
