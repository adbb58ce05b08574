"""Masses and circuit of a tubular actuator, from posteriors or from stated values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from deabayes.experiment import FloatArray, Specimen
from deabayes.papers.base import Row, StudyContext, labels
from deabayes.posteriors.fitted import Fitted
from deabayes.systems.specimen_quantities import uncertain_quantities
from deabayes.systems.tubular.base import CIRCUIT_SYMBOLS, TubularBase
from deabayes.systems.tubular.circuit import Circuit

STATED_DRAWS = 4000
STATED: Mapping[str, object] = {"candidate": "specimen.yaml", "order": "", "converged": True}
"""First columns of a row that rests on stated values only."""


def circuits(context: StudyContext, rng: np.random.Generator) -> list[tuple[Row, Circuit]]:
    """Draws of R_S, R_L and C of every candidate with a circuit, else of the stated values.

    The list is empty if no candidate has a circuit and the specimen states none.
    """
    fitted_ones = [
        (first, system.circuit_of(fitted.draws))
        for first, fitted, system in systems_with(context, "circuit")
    ]
    if fitted_ones or not stated(context.specimen, CIRCUIT_SYMBOLS):
        return fitted_ones
    drawn = prior_draws(context.specimen, CIRCUIT_SYMBOLS, rng)
    return [(dict(STATED), Circuit(*drawn.values()))]


def systems_with(context: StudyContext, part: str) -> Iterator[tuple[Row, Fitted, TubularBase]]:
    """Yield every candidate whose system has the `part` `circuit` or `inertia`.

    If the fitted system does not have it, the systems that predict (`predict_with`) are searched.
    The first columns then say that the part follows its prior.
    """
    for name, fitted in context.candidates.items():
        for system in (fitted.system, *fitted.predicts_with.values()):
            if isinstance(system, TubularBase) and getattr(system, part):
                first = labels(name, fitted)
                if system is not fitted.system:
                    first["candidate"] = f"{name} (prior, not fitted)"
                yield first, fitted, system
                break


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
