"""Multiply the response: a load cell wired the wrong way round, an amplifier's gain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from deabayes.faults import UserError
from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def scale(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Multiply the response by a number; the raw file stays what it is.

    Settings
    --------
    by : the number, -1 to turn the sign.
    response : the only channel this is for, where records of one protocol read several.
    record : the only experiment this is for; default all of the protocol.
    """
    read = Settings("scale", settings, record, ("by", "response", "record"))
    if read.of_another():
        return record
    factor = read.quantity("by", "1")
    if factor == 0.0:
        raise UserError(f"{read.where}.by: 0 leaves nothing of the response; give -1 or a gain")
    return replace(record, response=factor * record.response)
