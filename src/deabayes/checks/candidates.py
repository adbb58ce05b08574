"""The candidates that a study names, built; those of a user's own system checked as well."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deabayes.faults import Faults, UserError
from deabayes.own_models.candidate_checks import candidate_faults
from deabayes.own_models.loading import said_of_the_model

if TYPE_CHECKING:
    from deabayes.experiment import Specimen
    from deabayes.study import Study
    from deabayes.systems import System


def built_candidates(study: Study, specimen: Specimen, faults: list[str]) -> dict[str, System]:
    """The candidates that can be built; what is wrong with others, or with what they predict with,
    is added to the faults.
    """
    systems, found = {}, []
    for candidate in study.candidates:
        key = "candidates"
        try:
            systems[candidate] = _built(study, candidate, specimen)
            key = "predict_with"
            for ending in study.predict_with.values():
                _built(study, candidate + ending, specimen)
        except UserError as error:
            found += [f"study {study.name}, {key}: {each}" for each in str(error).splitlines()]
    faults += dict.fromkeys(found)
    return systems


def _built(study: Study, candidate: str, specimen: Specimen) -> System:
    """A candidate, and if it is of a user's own system, one that is as it should be."""
    from deabayes.systems import build

    if study.model is None:
        return build(specimen.system, candidate, specimen)
    with said_of_the_model():
        system = build(specimen.system, candidate, specimen)
        faults = candidate_faults(system, candidate)
    if faults:
        raise Faults(f"{study.model}: {fault}" for fault in faults)
    return system
