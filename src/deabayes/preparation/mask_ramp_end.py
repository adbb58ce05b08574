"""Hide the end of a ramp, where a machine's crosshead overshoots and springs back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.preparation.polyline import turns
from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord

OVER_NOISE, OVER_STEP = 10.0, 2.0
LARGEST_TURN = 0.25
"""Share of the excitation's range that a turn need not exceed, whatever the noise."""


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
    """The last turn reached at more than half of the ramp's largest speed.

    Speed is that of the excitation's departure from its first value, so the
    way back of a triangle does not count, nor does a slow spring back. It is taken between turns
    that stand out of the noise: from sample to sample noise would be the fastest.
    """
    time, values = record.excitation_coordinate, record.excitation
    knots = turns(time, values, min(_unseen(values), LARGEST_TURN * record.excitation_range))
    departure = np.abs(values[knots] - values[0])
    speed = np.diff(departure) / np.diff(time[knots])
    fast = np.flatnonzero(speed > 0.5 * speed.max())
    return float(time[knots[fast[-1] + 1]])


def _unseen(values: FloatArray) -> float:
    """How little a turn can stand out to be told from noise and from a digital sensor's steps."""
    rough, steps = np.abs(np.diff(values, 2)), np.abs(np.diff(values))
    noise = 1.4826 * float(np.median(rough)) / np.sqrt(6.0) if rough.size else 0.0
    return max(OVER_NOISE * noise, OVER_STEP * float(np.min(steps[steps > 0.0], initial=np.inf)))
