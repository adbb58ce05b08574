"""Detect whether a response rings after a step, like a mass on a spring."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.records.glitches import least_swing, without_single_samples
from deabayes.records.preparation.bins import CORNER_FRACTION
from deabayes.records.preparation.polyline import corners
from deabayes.records.preparation.working import WorkingRecord

FEWEST_TURNS = 2
DECAYED = 0.5
EARLY = 0.75
FIRST_TURNS = 6


@dataclass(frozen=True)
class Ringing:
    """A decaying oscillation: its period, its start, and its last visible turn [s]."""

    period: float
    start: float
    end: float


def ringing(record: WorkingRecord) -> Ringing | None:
    """Return the fastest ringing between corners of the excitation, or None.

    Turns of the response count if they are more than 2 % of its range, and ten times its noise,
    apart. At least a peak and a trough are needed; single outlying samples do not count. The
    turns must end, or lose half of their height, within the stretch. An oscillation that does
    not, such as mains hum, is no ringing.
    """
    time, response = record.coordinate[record.used], record.response[record.used]
    swing = least_swing(response)
    response = without_single_samples(response, swing)
    interval = float(np.median(np.diff(time)))
    tolerance = CORNER_FRACTION * record.excitation_range
    inner = corners(record.excitation_coordinate, record.excitation, tolerance, interval)
    edges = [record.excitation_start(), *map(float, inner), np.nextafter(time[-1], np.inf)]
    found = []
    for start, end in pairwise(edges):
        inside = slice(*np.searchsorted(time, [start, end]))
        found.append(_of_stretch(time[inside], response[inside], swing))
    return min((each for each in found if each), key=lambda each: each.period, default=None)


def _of_stretch(time: FloatArray, response: FloatArray, swing: float) -> Ringing | None:
    turns = np.array(_turns(response.tolist(), swing), dtype=np.intp)
    if turns.size < FEWEST_TURNS:
        return None
    heights = np.abs(np.diff(response[turns]))
    ended = time[turns[-1]] < time[0] + EARLY * (time[-1] - time[0])
    if not ended and heights[-1] > DECAYED * heights[0]:
        return None
    half = float(np.median(np.diff(time[turns[:FIRST_TURNS]])))
    return Ringing(2.0 * half, float(time[0]), float(time[turns[-1]]))


def _turns(values: list[float], swing: float) -> list[int]:
    """Return indices of peaks and troughs that differ by more than `swing` from what follows."""
    turns: list[int] = []
    high = low = 0
    direction = 0
    for index, value in enumerate(values):
        high = index if value > values[high] else high
        low = index if value < values[low] else low
        if direction >= 0 and values[high] - value > swing:
            turns += [high] if direction else []
            direction, low = -1, index
        elif direction <= 0 and value - values[low] > swing:
            turns += [low] if direction else []
            direction, high = 1, index
    return turns
