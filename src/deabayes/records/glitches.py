"""Single samples that stand out, and jumps that only one channel of a record has."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.quantities import with_unit

SWING = 0.02
"""Of the response's range: less is no swing."""
OVER_NOISE = 10.0
STEADY = 0.02
"""Of the excitation's range: more is a change that a response follows."""
LEVEL = 0.25
"""Of a sample's height over its neighbours: what differs more behind it may oscillate."""
BEHIND = 3
JUMPS = 10
"""As large as single samples of an excitation, for each of them: more are its own."""


def least_swing(response: FloatArray) -> float:
    """What is clearly more than noise: 2 % of a response's range, and ten times its noise."""
    return max(SWING * float(np.ptp(response)), OVER_NOISE * _noise(response))


def single_samples(response: FloatArray, swing: float) -> NDArray[np.intp]:
    """Indices of samples further than `swing` beyond both neighbours, with level ones behind.

    What oscillates is not level behind a peak.
    """
    padded = np.pad(response, (1, BEHIND), mode="edge")
    before = padded[: response.size]
    behind = np.array([padded[k : k + response.size] for k in range(2, 2 + BEHIND)])
    beyond = np.minimum(response - before, response - behind[0])
    below = np.minimum(before - response, behind[0] - response)
    height = np.maximum(beyond, below)
    return np.flatnonzero((height > swing) & (np.ptp(behind, axis=0) <= LEVEL * height))


def without_single_samples(response: FloatArray, swing: float) -> FloatArray:
    """The response with each of its `single_samples` at the mean of its neighbours."""
    found = single_samples(response, swing)
    mended = response.copy()
    mended[found] = 0.5 * (response[found - 1] + response[found + 1])
    return mended


def standing_out(
    excitation: FloatArray, excitation_range: float, response: FloatArray
) -> NDArray[np.intp]:
    """Single samples of a response while the excitation stays as it is."""
    found = single_samples(response, least_swing(response))
    change = np.abs(np.diff(np.pad(excitation, (1, BEHIND), mode="edge")))
    moved = np.max([change[k : k + response.size] for k in range(BEHIND + 1)], axis=0)
    return found[moved[found] <= STEADY * excitation_range]


def glitches(excitation: FloatArray, response: FloatArray) -> NDArray[np.intp]:
    """Single samples of an excitation that is as before behind them, which no response follows.

    None where the excitation jumps as far time and again, as random levels do.
    """
    found = single_samples(excitation, least_swing(excitation))
    before, behind = excitation[found - 1], excitation[found + 1]
    height = np.minimum(np.abs(excitation[found] - before), np.abs(excitation[found] - behind))
    followed = _off_neighbours(response) > least_swing(response)
    alone = (np.abs(behind - before) <= LEVEL * height) & ~(followed[found] | followed[found + 1])
    found, height = found[alone], height[alone]
    far = np.abs(np.diff(excitation)) > 0.5 * np.min(height, initial=np.inf)
    return found if far.sum() <= JUMPS * found.size else found[:0]


def named(
    found: NDArray[np.intp],
    time: FloatArray,
    values: FloatArray,
    channel: str,
    unit: str,
    remedy: str,
) -> str:
    """A sentence on samples that were found, the first of them with its time and value."""
    at = int(found[0])
    value, beside = (with_unit(float(values[i]), unit, channel) for i in (at, at + 1))
    others = f" (and {found.size - 1} more)" if found.size > 1 else ""
    return (
        f"column {channel}: the single sample at {time[at]:.6g} s, {value} before {beside}, "
        f"stands out{others}; {remedy}"
    )


def _off_neighbours(values: FloatArray) -> FloatArray:
    """How far each sample is off the mean of its neighbours."""
    return np.abs(np.pad(0.5 * np.diff(values, 2), 1))


def _noise(values: FloatArray) -> float:
    """Standard deviation of what differs from one sample to the next."""
    steps = np.abs(np.diff(values, 2))
    return float(1.4826 * np.median(steps) / np.sqrt(6.0)) if steps.size else 0.0


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
