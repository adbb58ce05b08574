"""How fast a record's excitation changes, as the frequency of the sine that is as fast."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray

SHARE = 0.2
"""Of an excitation's range: noise of a monitor must not count as change."""
SINE = 2.0 * math.asin(SHARE)
"""Phase [rad] in which a sine changes by that share of its range, where it is steepest."""
BISECTIONS = 12
INSTANT = 1e-9
LATE = 1.1
"""What takes this many times as long is still as fast."""


def fastest(experiment: Experiment) -> float:
    r"""Highest frequency that a record's response can tell of [Hz]; NaN without a time axis.

    An excitation that needs the time t for a fifth of its range, where it is steepest, is as
    fast as a sine of 2 arcsin(1/5) / (2 pi t): exact for sines, 0.32 / T for a ramp that lasts
    T. A step has no such end; there it is what was read soonest after it, at the time t, that
    decides, and creep at t is what a sine with omega = 1 / t shows. Changes that nothing was
    read soon after, such as a step before a cropped sine, leave the word to slower ones.
    """
    if experiment.coordinate_name != "time":
        return float("nan")
    span = float(np.ptp(experiment.excitation.coordinate))
    excitation = _from_rest(experiment.excitation, span)
    if span == 0.0 or np.ptp(excitation.values) == 0.0:
        return 0.0
    time, omega = _shortest_change(excitation), 0.0
    while omega < SINE / time and time < span:
        soonest = _soonest(excitation, experiment.coordinate, time)
        omega = max(omega, min(SINE / time, 1.0 / soonest))
        time *= LATE
    return omega / (2.0 * math.pi)


def _from_rest(excitation: Excitation, span: float) -> Excitation:
    """A voltage is zero before its first knot: a first value other than that is a step."""
    if excitation.unit != "V":
        return excitation
    knots, first = excitation.coordinate, excitation.coordinate[0]
    risen = first + INSTANT * span
    return replace(
        excitation,
        coordinate=np.concatenate([[first, risen], knots[1:]]),
        values=np.append(0.0, excitation.values),
    )


def _shortest_change(excitation: Excitation) -> float:
    """The shortest time in which it changes by `SHARE` of its range [s]."""
    spacing = np.diff(excitation.coordinate)
    wanted = SHARE * float(np.ptp(excitation.values))
    longer = SHARE * float(spacing[spacing > 0.0].min())
    while _changes(excitation, longer).max() < wanted:
        longer *= 2.0
    shorter = 0.5 * longer
    for _ in range(BISECTIONS):
        middle = 0.5 * (shorter + longer)
        if _changes(excitation, middle).max() >= wanted:
            longer = middle
        else:
            shorter = middle
    return longer


def _changes(excitation: Excitation, time: float) -> FloatArray:
    """Changes within `time` that begin at a knot, and those that end at one, (2, K)."""
    knots, values = excitation.coordinate, excitation.values
    after, before = excitation.at(knots + time) - values, values - excitation.at(knots - time)
    return np.abs(np.stack([after, before]))


def _soonest(excitation: Excitation, read: FloatArray, time: float) -> float:
    """From the beginning of a change within about `time` to a reading after it, at least [s]."""
    time *= LATE
    begins, ends = _changes(excitation, time) >= SHARE * float(np.ptp(excitation.values))
    knots = excitation.coordinate
    starts = np.concatenate([knots[begins], knots[ends] - time])
    following = np.searchsorted(read, starts + time)
    followed = following < read.size
    if not followed.any():
        return math.inf
    return float(np.min(read[following[followed]] - starts[followed]))
