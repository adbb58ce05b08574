"""Take the sensor's reading before the step as zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from deabayes.faults import UserError
from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def baseline(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Subtract the mean of the response before the excitation starts.

    Settings
    --------
    until : end of the stretch that is averaged; default where the excitation starts.
    response : the only channel this is for, where records of one protocol read several: at
        rest a displacement is zero, an area or a stretch is not.
    """
    read = Settings("baseline", settings, record, ("until", "response"))
    if read.of_another():
        return record
    until = read.quantity("until", record.coordinate_unit, record.excitation_start())
    rest = record.used & (record.coordinate <= until)
    if rest.sum() < 2:
        raise UserError(
            f"{read.where}: {int(rest.sum())} samples up to {until:g} {record.coordinate_unit}, "
            "where the excitation starts; give `until`, or leave the step out"
        )
    return replace(record, response=record.response - record.response[rest].mean())
