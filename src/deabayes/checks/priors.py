"""The priors that a study writes down, held against its candidates' parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from deabayes.faults import UserError

if TYPE_CHECKING:
    from deabayes.experiment import Experiment
    from deabayes.study import Study
    from deabayes.systems import System


def check_priors(
    study: Study, systems: Mapping[str, System], experiments: Sequence[Experiment]
) -> tuple[list[str], list[str]]:
    """Faults: priors that name no parameter of any candidate, or that cannot be used.

    Warnings: numbers without a unit, of parameters that have one.
    """
    from deabayes.noise import REGISTRY as NOISE
    from deabayes.predict_with import wider_systems
    from deabayes.prior.joint import Prior
    from deabayes.prior.overrides import bare_numbers
    from deabayes.record_noise import noise_parameters

    calibrate = [each for each in experiments if each.role == "calibrate"]
    if not systems:
        return [], []
    system = next(iter(systems.values()))
    try:
        noise = noise_parameters(study, NOISE[study.noise](), calibrate, system)
    except UserError as error:
        return [f"study {study.name}, {error}"], []
    every = [each for s in systems.values() for each in (s, *wider_systems(study, s).values())]
    known = [p.name for system in every for p in system.parameters()]
    faults: list[str] = []
    bare: list[str] = []
    for system in systems.values():
        parameters = (*system.parameters(), *noise)
        try:
            Prior.from_parameters(parameters, study.priors, known)
            bare += bare_numbers(parameters, study.priors, known)
        except UserError as error:
            faults += str(error).splitlines()
    return _said(study, faults), _said(study, bare)


def _said(study: Study, sentences: Sequence[str]) -> list[str]:
    return [f"study {study.name}, {sentence}" for sentence in dict.fromkeys(sentences)]
