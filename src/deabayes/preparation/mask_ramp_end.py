"""Hide the end of a ramp, where a machine's crosshead overshoots and springs back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def mask_ramp_end(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response around the end of the ramp.

    What is hidden is the response only: the overshoot is a motion that the
    specimen went through and stays in the excitation. The load cell's own
    inertia answers the braking with a transient that is no material response.

    Settings
    --------
    before, after : widths on both sides of the ramp's end; default 0.1 s and 0.3 s.
    at : the ramp's end, where it should not be detected.
    """
    read = Settings("mask_ramp_end", settings, record, ("before", "after", "at"))
    end = read.quantity("at", record.coordinate_unit, ramp_end(record))
    before = read.quantity("before", record.coordinate_unit, 0.1)
    after = read.quantity("after", record.coordinate_unit, 0.3)
    return record.mask((record.coordinate >= end - before) & (record.coordinate <= end + after))


def ramp_end(record: WorkingRecord) -> float:
    """The last knot reached at more than half of the ramp's largest speed.

    Speed is that of the excitation's departure from its first value, so the
    way back of a triangle does not count, nor does a slow spring back.
    """
    departure = np.abs(record.excitation - record.excitation[0])
    speed = np.diff(departure) / np.diff(record.excitation_coordinate)
    fast = np.flatnonzero(speed > 0.5 * speed.max())
    return float(record.excitation_coordinate[fast[-1] + 1])
