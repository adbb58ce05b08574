"""Records of a folder that no candidate of its system has a response to, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deabayes.faults import MissingQuantity, UserError

if TYPE_CHECKING:
    from deabayes.experiment import Excitation, Specimen
    from deabayes.reading.folder import StudyFolder
    from deabayes.reading.raw import ExperimentRow

SAMPLES = 50
"""Of a record that are shown to a candidate: it need only say whether it can."""


def without_candidate(read: StudyFolder) -> list[str]:
    """What is missing where no candidate can predict a record: a quantity, or what was held.

    Each complaint is said once, of the first record that has it. Of a record with faults only the
    quantities are asked. Nothing is said of a specimen.yaml with faults, and systems of the
    user's own are left to their own checks.
    """
    from deabayes.systems import OWN, REGISTRY

    system = read.specimen.system
    if system in OWN or system not in REGISTRY or not read.file.sound:
        return []
    found: dict[str, str] = {}
    for row in read.table:
        try:
            reasons = _reasons(read.specimen, row, _driven(read, row))
        except UserError:  # said elsewhere
            reasons = _reasons(read.specimen, row, _stand_in(row, system))
            reasons = [each for each in reasons if isinstance(each, MissingQuantity)]
        for reason in map(str, reasons):
            found.setdefault(reason, f"{read.path / 'experiments.csv'} ({row.name}): {reason}")
    return list(found.values())


def _driven(read: StudyFolder, row: ExperimentRow) -> Excitation:
    """The beginning of a record's excitation."""
    from deabayes.experiment import Excitation
    from deabayes.preparation.opening import conditions, open_record

    raw = read.record(row)
    record = open_record(row, raw, read.specimen)
    return Excitation(
        record.row.excitation,
        record.excitation_unit,
        record.excitation_coordinate[:SAMPLES],
        record.excitation[:SAMPLES],
        conditions(record.row, raw),
        record.in_time,
    )


def _stand_in(row: ExperimentRow, system: str) -> Excitation:
    """An excitation as a record with faults may have it, to ask which quantities it needs."""
    from deabayes.experiment import Excitation
    from deabayes.reading.columns import COMMANDS
    from deabayes.reading.record_checks import POSITIVE
    from deabayes.reading.table import WITHOUT_TIME, channels_of

    unit = channels_of(system, row.protocol)[0][row.excitation]
    time = np.linspace(0.0, 1.0, SAMPLES)
    values = 1.0 + 0.1 * time if row.excitation in POSITIVE else 1e-3 * time
    in_time = row.protocol not in WITHOUT_TIME
    name = COMMANDS.get(row.excitation, row.excitation)
    held = {**row.metadata, "voltage": 0.0}
    return Excitation(name, unit, time if in_time else values, values, held, in_time)


def _reasons(specimen: Specimen, row: ExperimentRow, driven: Excitation) -> Sequence[UserError]:
    """Why no candidate predicts a record; none if one may.

    All quantities that the first candidate lacks that lacks any, or else what the first one says.
    That a candidate is not one for this response says nothing: only examples are tried.
    """
    from deabayes.systems import candidates

    each = [_obstacles(specimen, name, row, driven) for name in candidates(specimen.system)]
    if [] in each:
        return []
    general = [found for found in each if not str(found[-1]).startswith("candidate ")]
    lacking = [[e for e in found if isinstance(e, MissingQuantity)] for found in general]
    return next(filter(None, lacking), next(iter(general), []))


def _obstacles(
    specimen: Specimen, candidate: str, row: ExperimentRow, driven: Excitation
) -> Sequence[UserError]:
    """Every quantity that a candidate lacks, and what else keeps it from predicting a record."""
    from deabayes.experiment import Quantity
    from deabayes.systems import build

    found: list[UserError] = []
    while True:
        try:
            build(specimen.system, candidate, specimen).simulator(
                driven, driven.coordinate, row.response
            )
        except MissingQuantity as lacking:
            found.append(lacking)
            stand_in = {lacking.quantity: Quantity(1.0, lacking.unit)}
            specimen = replace(specimen, quantities={**specimen.quantities, **stand_in})
        except UserError as error:
            return [*found, error]
        else:
            return found
