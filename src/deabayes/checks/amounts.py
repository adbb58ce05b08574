"""Whether what a study prepares is enough for its candidates, and all of it of use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from deabayes.reading.checks import too_few_points

if TYPE_CHECKING:
    from deabayes.experiment import Experiment
    from deabayes.study import Study
    from deabayes.systems import System


def few_points(
    study: Study, systems: Mapping[str, System], experiments: Sequence[Experiment]
) -> list[str]:
    """Candidates with as many parameters as there are points to fit, once they are prepared."""
    fitted = [each.response.size for each in experiments if each.role == "calibrate"]
    if not fitted:  # which is a fault of its own
        return []
    return [
        fault
        for candidate, system in systems.items()
        for fault in too_few_points(
            sum(fitted), len(system.parameters()), f"study {study.name}, {candidate}"
        )
    ]


def unused_steps(
    study: Study, protocols: Iterable[str], known: Iterable[str]
) -> tuple[list[str], list[str]]:
    """Faults and warnings: preparation of protocols that no record of the study has.

    Parameters
    ----------
    protocols : of the study's records.
    known : those that the specimen's system has a model of; others are a fault.
    """
    protocols, known = list(protocols), list(known)
    faults = [
        f"study {study.name}, preparation: the specimen's system has no model of protocol {name!r} "
        f"(it has {', '.join(known)}); correct or remove it"
        for name in study.preparation
        if name not in known
    ]
    warnings = [
        f"study {study.name}, preparation.{name}: no record of the study is of this protocol, so "
        "these steps do nothing"
        for name in study.preparation
        if name in known and name not in protocols
    ]
    return faults, warnings
