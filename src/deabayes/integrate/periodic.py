"""Periodic signals: when they pass a level, their period, and their roughness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray

HYSTERESIS = 0.1
ALIKE = 0.05
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]


def passes(coordinate: FloatArray, values: FloatArray) -> FloatArray:
    """Where a signal passes the middle of its range, in the direction in which it does so oftener.

    A pass counts once the signal has gone from a tenth of its range below the middle to a
    tenth above, or the other way: noise makes no passes, and a signal that never crosses
    zero has them too.
    """
    size = float(np.ptp(values)) or 1.0
    scaled = (values - 0.5 * (values.max() + values.min())) / size
    up, down = _rises(coordinate, scaled), _rises(coordinate, -scaled)
    return up if up.size >= down.size else down


def _rises(coordinate: FloatArray, values: FloatArray) -> FloatArray:
    """Zeros of the lines that rise from below -HYSTERESIS to above HYSTERESIS."""
    low, high = _risen(values)
    share = -values[low] / (values[high] - values[low])
    return np.asarray(coordinate[low] + share * (coordinate[high] - coordinate[low]))


def _risen(values: FloatArray) -> tuple[IntArray, IntArray]:
    """Last samples below -HYSTERESIS and first ones above HYSTERESIS, of each rise."""
    decided = np.flatnonzero(np.abs(values) > HYSTERESIS)
    signs = np.sign(values[decided])
    rise = np.flatnonzero((signs[:-1] < 0) & (signs[1:] > 0))
    return decided[rise], decided[rise + 1]


def upward_crossings(coordinate: FloatArray, values: FloatArray, level: float) -> FloatArray:
    """Where a signal rises through any level by a tenth of its range on either side.

    In the middle between the first and the last crossing of a rise: noise makes several, and a
    line across the whole rise would be off where the signal bends, as a sine does.
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
    """Which distances of successive passes are the usual one within 5 %."""
    gaps = np.diff(times)
    usual = float(np.median(gaps))
    return np.asarray(np.abs(gaps - usual) <= ALIKE * usual)


def steady(times: FloatArray) -> FloatArray:
    """The longest stretch of passes that follow each other at their usual distance."""
    change = np.diff(np.concatenate([[0], alike(times).astype(int), [0]]))
    first, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    if first.size == 0:
        return times[:1]
    longest = int(np.argmax(end - first))
    return times[first[longest] : end[longest] + 1]


def usual_period(times: FloatArray) -> float:
    """Median over pairs of passes half a steady stretch apart; NaN below two passes.

    A first ramp to the bias is not in that stretch; nor does, in a median, a first pass count
    that a limited amplifier delays.
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
"""Of the peak: samples that scatter more are levels of their own, not a monitor's noise."""


def roughness(values: FloatArray) -> float:
    """Standard deviation of evenly spaced samples (N,) about a smooth curve (robust).

    From sixth differences, which a sine of 40 samples per period passes with 1e-5 of its
    amplitude; steps and corners are too few to count. 0 where it is too much for noise: an
    excitation that changes from sample to sample (random levels, a triangle of few samples) has
    such differences too.
    """
    sixth = np.abs(np.diff(values, 6))
    found = float(np.median(sixth)) / SIXTH_DIFFERENCE if sixth.size else 0.0
    return found if found <= NOISIEST * float(np.max(np.abs(values))) else 0.0
