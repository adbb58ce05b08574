"""Level crossings, period and roughness of periodic signals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray

HYSTERESIS = 0.1
ALIKE = 0.05
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]


def passes(coordinate: FloatArray, values: FloatArray) -> FloatArray:
    """Coordinates where a signal passes the middle of its range, in the more frequent direction.

    A pass counts if the signal goes from a tenth of its range below the middle to a tenth
    above, or the reverse. Noise therefore makes no passes, and a signal that never crosses zero
    has passes too.
    """
    size = float(np.ptp(values)) or 1.0
    scaled = (values - 0.5 * (values.max() + values.min())) / size
    up, down = _rises(coordinate, scaled), _rises(coordinate, -scaled)
    return up if up.size >= down.size else down


def _rises(coordinate: FloatArray, values: FloatArray) -> FloatArray:
    """Zeros of the straight lines across each rise from below -HYSTERESIS to above HYSTERESIS."""
    low, high = _risen(values)
    share = -values[low] / (values[high] - values[low])
    return np.asarray(coordinate[low] + share * (coordinate[high] - coordinate[low]))


def _risen(values: FloatArray) -> tuple[IntArray, IntArray]:
    """Indices of the last sample below -HYSTERESIS and the first above HYSTERESIS of each rise."""
    decided = np.flatnonzero(np.abs(values) > HYSTERESIS)
    signs = np.sign(values[decided])
    rise = np.flatnonzero((signs[:-1] < 0) & (signs[1:] > 0))
    return decided[rise], decided[rise + 1]


def upward_crossings(coordinate: FloatArray, values: FloatArray, level: float) -> FloatArray:
    """Coordinates where a signal rises through `level`, by a tenth of its range on either side.

    Noise may make several crossings in one rise. The result is the middle between the first and
    the last crossing. A line across the whole rise would be inaccurate for a bent signal, such
    as a sine.
    """
    scaled = (values - level) / (float(np.ptp(values)) or 1.0)
    low, high = _risen(scaled)
    below = scaled < 0.0
    before = np.flatnonzero(below[:-1] != below[1:])
    share = -scaled[before] / (scaled[before + 1] - scaled[before])
    at = coordinate[before] + share * (coordinate[before + 1] - coordinate[before])
    first, last = np.searchsorted(before, low), np.searchsorted(before, high) - 1
    return np.asarray(0.5 * (at[first] + at[last]))


def alike(times: FloatArray) -> BoolArray:
    """Whether the distances of successive passes are within 5 % of their median."""
    gaps = np.diff(times)
    usual = float(np.median(gaps))
    return np.asarray(np.abs(gaps - usual) <= ALIKE * usual)


def steady(times: FloatArray) -> FloatArray:
    """Longest run of passes that follow each other at the median distance."""
    change = np.diff(np.concatenate([[0], alike(times).astype(int), [0]]))
    first, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    if first.size == 0:
        return times[:1]
    longest = int(np.argmax(end - first))
    return times[first[longest] : end[longest] + 1]


def usual_period(times: FloatArray) -> float:
    """Median period over pairs of passes half a steady run apart; NaN for less than two passes.

    The steady run excludes an initial ramp to the bias. The median ignores a first pass that an
    amplifier of limited current delays.
    """
    if times.size < 2:
        return float("nan")
    stretch = steady(times)
    stretch = stretch if stretch.size > 1 else times
    half = stretch.size // 2
    return float(np.median(stretch[half:] - stretch[:-half]) / half)


SIXTH_DIFFERENCE = 0.6745 * np.sqrt(924.0)
"""Median absolute sixth difference of white noise over its standard deviation."""
NOISIEST = 0.01
"""Largest noise of a monitor, relative to the peak; a larger scatter belongs to the signal."""


def roughness(values: FloatArray) -> float:
    """Standard deviation of evenly spaced samples (N,) about a smooth curve (robust).

    The estimate uses sixth differences. A sine of 40 samples per period contributes 1e-5 of its
    amplitude to them. Steps and corners are too few to affect the median. The result is 0 if it
    is too large for noise: an excitation that changes from sample to sample (random levels, a
    triangle of few samples) has large differences too.
    """
    sixth = np.abs(np.diff(values, 6))
    found = float(np.median(sixth)) / SIXTH_DIFFERENCE if sixth.size else 0.0
    return found if found <= NOISIEST * float(np.max(np.abs(values))) else 0.0
