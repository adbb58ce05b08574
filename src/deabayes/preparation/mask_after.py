"""Hide the last part of a record: failure, a drifting sensor, an interrupted run."""

from __future__ import annotations

from collections.abc import Mapping

from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def mask_after(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response after `time`.

    Settings
    --------
    time : on the record's coordinate (a stretch, for a quasi-static record in stretch).
    from_step : count `time` from the start of the excitation; default false.
    """
    read = Settings("mask_after", settings, record, ("time", "from_step"))
    return record.mask(record.coordinate > read.coordinate("time"))
