"""Jumps in one of a record's two channels only: a slip, a break, a monitor's dropout."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit
from deabayes.reading.single_samples import STEADY, least_swing, single_samples

SETTLED, SAME_RATE = 20, 0.2
"""Samples on each side of a response's jump in which the excitation must be steady; and of its
largest change over as many, by which those before and behind may differ."""
AROUND, USUAL = 8, 8.0
"""Neighbours on each side of a jump, and how many times their median change it must be."""
OF_RESOLUTION = 1.5
"""Times the smallest change there is, below which a jump is a step of the display."""
BACK = 0.1
"""Of a dropout's height: how far the excitation may be from where it was, behind it."""
LONGEST = 8
"""Samples of a dropout; what lasts longer is a pulse."""


def response_jumps(
    excitation: FloatArray, excitation_range: float, response: FloatArray
) -> NDArray[np.intp]:
    """Samples at which a response has jumped, though the excitation was steady around it.

    A jump is beyond `least_swing` and `USUAL` times what the response usually changes by
    there. Single samples that stand out are not among them, nor steps of a coarse display.
    """
    change = np.abs(np.diff(response))
    if change.size < 2 * AROUND + 1 or not change.any():
        return np.empty(0, dtype=np.intp)
    swing = least_swing(response)
    least = max(swing, OF_RESOLUTION * float(np.min(change[change > 0.0])))
    around = np.pad(change, AROUND, mode="reflect")
    usual = np.median(sliding_window_view(around, 2 * AROUND + 1), axis=1)
    driven = _driven(excitation, excitation_range)
    found = np.flatnonzero((change > np.maximum(least, USUAL * usual)) & ~driven) + 1
    alone = single_samples(response, swing)
    return np.setdiff1d(found, np.concatenate([alone, alone + 1]))


def _driven(excitation: FloatArray, excitation_range: float) -> NDArray[np.bool_]:
    """Between which samples an excitation jumps nearby, begins, stops or turns round."""
    moved = np.abs(np.diff(excitation)) > STEADY * excitation_range
    jumps = sliding_window_view(np.pad(moved, SETTLED), 2 * SETTLED + 1).any(axis=1)
    padded = np.pad(excitation, SETTLED, mode="edge")
    over = padded[SETTLED:] - padded[:-SETTLED]
    before, behind = over[:-SETTLED], over[SETTLED:]
    turns = np.abs(behind - before) > SAME_RATE * float(np.max(np.abs(over)))
    return np.asarray(jumps | turns[:-1] | turns[1:])


def dropouts(excitation: FloatArray, response: FloatArray) -> NDArray[np.intp]:
    """First samples of short departures of a held excitation that the response does not follow.

    One of a single sample is a `glitch`.
    """
    swing, follows = least_swing(excitation), least_swing(response)
    jumped = np.flatnonzero(np.abs(np.diff(excitation)) > swing)
    found = []
    for first, last in itertools.pairwise(jumped):
        away = excitation[first + 1 : last + 1]
        height = np.min(np.abs(away - excitation[first]))
        back = abs(excitation[last + 1] - excitation[first]) <= BACK * height
        near = response[first : last + 2]
        if 1 < away.size <= LONGEST and back and float(np.ptp(near)) <= follows:
            found.append(first + 1)
    return np.array(found, dtype=np.intp)


def jump_named(
    found: NDArray[np.intp], time: FloatArray, channel: str, size: float, unit: str, remedy: str
) -> str:
    """A sentence on jumps that were found; `size` is that of the first."""
    others = f" (and {found.size - 1} more)" if found.size > 1 else ""
    return (
        f"column {channel}: jumps by {with_unit(size, unit, channel, digits=3)} at "
        f"{time[found[0]]:.6g} s{others}, {remedy}"
    )
