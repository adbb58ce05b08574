"""Hide the ends of ramps, where a machine's crosshead overshoots and springs back."""

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
    """Hide the response around the end of every ramp.

    What is hidden is the response only: the overshoot is a motion that the
    specimen went through and stays in the excitation. The load cell's own
    inertia answers the braking with a transient that is no material response.

    Settings
    --------
    before, after : widths on both sides of the ramp's end; default 0.1 s and 0.3 s.
    at : the end of the only ramp, where it should not be detected.
    """
    read = Settings("mask_ramp_end", settings, record, ("before", "after", "at"))
    ends = [read.quantity("at", record.coordinate_unit)] if read.has("at") else ramp_ends(record)
    before = read.quantity("before", record.coordinate_unit, 0.1)
    after = read.quantity("after", record.coordinate_unit, 0.3)
    past = record.coordinate - np.array(ends)[:, None]
    return record.mask(np.any((past >= -before) & (past <= after), axis=0))


def ramp_ends(record: WorkingRecord) -> list[float]:
    """The turns reached at more than half of the largest speed and left at less.

    Speed is that of the excitation's departure from its first value, so the
    way back of a triangle does not count, nor does a slow spring back. It is taken between turns
    that stand out of the noise: from sample to sample noise would be the fastest.
    """
    time, values = record.excitation_coordinate, record.excitation
    knots = turns(time, values, min(_unseen(values), LARGEST_TURN * record.excitation_range))
    departure = np.abs(values[knots] - values[0])
    speed = np.diff(departure) / np.diff(time[knots])
    fast = np.append(speed > 0.5 * speed.max(), False)
    return [float(end) for end in time[knots[1:][fast[:-1] & ~fast[1:]]]]


def _unseen(values: FloatArray) -> float:
    """How little a turn can stand out to be told from noise and from a digital sensor's steps."""
    rough, steps = np.abs(np.diff(values, 2)), np.abs(np.diff(values))
    noise = 1.4826 * float(np.median(rough)) / np.sqrt(6.0) if rough.size else 0.0
    return max(OVER_NOISE * noise, OVER_STEP * float(np.min(steps[steps > 0.0], initial=np.inf)))
