"""Hide a stretch of a record: a glitch, a knock against the bench."""

from __future__ import annotations

from collections.abc import Mapping

from deabayes.faults import UserError
from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def mask_between(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response from `from` to `to`, both included.

    Settings
    --------
    from, to : on the record's coordinate (stretches, for a quasi-static record in stretch).
    from_step : count both from the start of the excitation; default false.
    record : the only experiment this is for; default all of the protocol.
    """
    read = Settings("mask_between", settings, record, ("from", "to", "from_step", "record"))
    if read.of_another():
        return record
    first, last = read.coordinate("from"), read.coordinate("to")
    if not first < last:
        raise UserError(f"{read.where}: `to` ({last:g}) must lie behind `from` ({first:g})")
    return record.mask((record.coordinate >= first) & (record.coordinate <= last))
