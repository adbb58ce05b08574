"""Hide the first part of a record: force blips of a starting machine, a closing switch."""

from __future__ import annotations

from collections.abc import Mapping

from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def mask_before(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response before `time`.

    Settings
    --------
    time : on the record's coordinate (a stretch, for a quasi-static record in stretch).
    from_step : count `time` from the start of the excitation; default false.
    """
    read = Settings("mask_before", settings, record, ("time", "from_step"))
    return record.mask(record.coordinate < read.coordinate("time"))
