"""Records of a folder that no candidate of its system has a response to, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deabayes.faults import UserError

if TYPE_CHECKING:
    from deabayes.experiment import Excitation
    from deabayes.reading.folder import StudyFolder
    from deabayes.reading.raw import ExperimentRow

LACKS = " lacks "
"""In what is said of a quantity that the specimen does not have."""
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
            reason = _reason(read, row, _driven(read, row))
        except UserError:  # said elsewhere
            reason = _reason(read, row, _stand_in(row, system))
            reason = reason if reason is not None and LACKS in reason else None
        if reason is not None:
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


def _reason(read: StudyFolder, row: ExperimentRow, driven: Excitation) -> str | None:
    """Why no candidate predicts a record: what the specimen lacks first; None if one may.

    That a candidate is not one for this response says nothing: only examples are tried.
    """
    from deabayes.systems import build, candidates

    reasons = []
    for candidate in candidates(read.specimen.system):
        try:
            system = build(read.specimen.system, candidate, read.specimen)
            system.simulator(driven, driven.coordinate, row.response)
        except UserError as error:
            reasons.append(str(error))
        else:
            return None
    general = [reason for reason in reasons if not reason.startswith("candidate ")]
    return min(general, key=lambda reason: LACKS not in reason, default=None)
