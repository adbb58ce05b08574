"""Records of a folder that no candidate of its system has a response to, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deabayes.faults import UserError

if TYPE_CHECKING:
    from deabayes.reading.folder import StudyFolder
    from deabayes.reading.raw import ExperimentRow, RawRecord

SAMPLES = 50
"""Of a record that are shown to a candidate: it need only say whether it can."""


def without_candidate(read: StudyFolder) -> list[str]:
    """What is missing where no candidate can predict a record: a quantity, or what was held.

    Each complaint is said once, of the first record that has it. Systems of the user's own are
    left to their own checks.
    """
    from deabayes.systems import OWN, REGISTRY

    system = read.specimen.system
    if system in OWN or system not in REGISTRY:
        return []
    found: dict[str, str] = {}
    for row in read.table:
        try:
            raw = read.record(row)
        except UserError:  # said elsewhere
            continue
        reason = _reason(read, row, raw)
        if reason is not None:
            found.setdefault(reason, f"{read.path / 'experiments.csv'} ({row.name}): {reason}")
    return list(found.values())


def _reason(read: StudyFolder, row: ExperimentRow, raw: RawRecord) -> str | None:
    """Why no candidate predicts a record: what the specimen lacks first; None if one may.

    That a candidate is not one for this response says nothing: only examples are tried.
    """
    from deabayes.experiment import Excitation
    from deabayes.preparation.opening import conditions, open_record
    from deabayes.systems import build, candidates

    record = open_record(row, raw, read.specimen)
    coordinate = record.excitation_coordinate[:SAMPLES]
    driven = Excitation(
        record.row.excitation,
        record.excitation_unit,
        coordinate,
        record.excitation[:SAMPLES],
        conditions(record.row, raw),
        record.in_time,
    )
    reasons = []
    for candidate in candidates(read.specimen.system):
        try:
            system = build(read.specimen.system, candidate, read.specimen)
            system.simulator(driven, coordinate, row.response)
        except UserError as error:
            reasons.append(str(error))
        else:
            return None
    general = [reason for reason in reasons if not reason.startswith("candidate ")]
    return min(general, key=lambda reason: " lacks " not in reason, default=None)
