"""Properties of a record's channels: steps, noise, single outlying samples and jumps."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Quantity, Specimen
from deabayes.faults import Report, UserError
from deabayes.quantities import with_unit
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.records.table import WITHOUT_TIME
from deabayes.systems import system_class
from deabayes.systems.specimen_quantities import instrument

STEPS = ("creep", "step")
NEAR = 0.02
"""Share of the largest excitation; a smaller first value is an offset, not a jump."""
HELD_CONSTANT = 0.01
MONITOR_NOISE = 10.0
"""Range of a monitored voltage at rest [V]; the force at 10 V is 1e-5 of the force at 3 kV."""
WIDEST_NOISE = 12.0
"""Largest range of white noise over its standard deviation; for 10^5 normal numbers it is 9."""
SWING = 0.02
"""Share of the response's range; smaller changes are no swing."""
OVER_NOISE = 10.0
STEADY = 0.02
"""Share of the excitation's range; the response may follow a larger change."""
LEVEL = 0.25
"""Share of a sample's height over its neighbours. If the samples behind it differ by more, the
response may oscillate."""
BEHIND = 3
JUMPS = 10
"""Most jumps per outlying sample of an excitation; more are part of the excitation."""
SETTLED, SAME_RATE = 20, 0.2
"""Number of samples on each side of a response's jump in which the excitation must be steady.
Second, the largest difference between the changes before and behind, as a share of its
largest change over as many samples."""
AROUND, USUAL = 8, 8.0
"""Neighbours on each side of a jump, and the smallest ratio of the jump to their median change."""
OF_RESOLUTION = 1.5
"""Multiple of the smallest change; a smaller jump is a step of the display."""
BACK = 0.1
"""Largest distance of the excitation from its old level after a dropout, as a share of its
height."""
LONGEST = 8
"""Most samples of a dropout; a longer one is a pulse."""


def usual_interval(coordinate: FloatArray) -> float:
    """Return the median distance of neighbouring samples."""
    return float(np.median(np.diff(coordinate)))


def is_held(voltage: FloatArray) -> bool:
    """Whether a voltage [V] varies by at most 1 % or a monitor's noise."""
    allowed = max(HELD_CONSTANT * abs(float(np.mean(voltage))), MONITOR_NOISE)
    return float(np.ptp(voltage)) <= allowed


def is_step_from_the_start(protocol: str, excitation: FloatArray, unit: str) -> bool:
    """Whether the excitation of a creep or step is on and constant from its first sample.

    A voltage may have a monitor's noise, which changes from sample to sample. A small step on a
    bias, or a drift, does not count as constant.
    """
    spread, size = float(np.ptp(excitation)), abs(float(np.mean(excitation)))
    noise = float(np.std(np.diff(excitation))) / np.sqrt(2.0) if unit == "V" else 0.0
    constant = spread <= WIDEST_NOISE * noise and is_held(excitation)
    return protocol in STEPS and constant and spread < size


def excitation_range(protocol: str, excitation: FloatArray, unit: str) -> float:
    """Largest change of an excitation; for a step at its first sample, its largest size."""
    if is_step_from_the_start(protocol, excitation, unit):
        return float(np.max(np.abs(excitation)))
    return float(np.ptp(excitation))


@dataclass(frozen=True)
class Check:
    """One record that is checked, and the report that its checks add to."""

    row: ExperimentRow
    raw: RawRecord
    specimen: Specimen
    report: Report

    @property
    def time(self) -> FloatArray:
        return self.raw.columns["time"]

    @property
    def excitation(self) -> FloatArray:
        return self.raw.columns[self.row.excitation]

    @property
    def response(self) -> FloatArray:
        return self.raw.columns[self.row.response]

    @property
    def in_time(self) -> bool:
        return self.row.protocol not in WITHOUT_TIME

    @property
    def is_pull(self) -> bool:
        """Whether the record is quasi-static and driven by something other than a voltage."""
        return self.row.protocol == "quasi_static" and self.row.excitation != "voltage"

    @property
    def is_step_from_the_start(self) -> bool:
        """Whether the excitation is on and constant from the first sample."""
        unit = self.raw.units[self.row.excitation]
        return is_step_from_the_start(self.row.protocol, self.excitation, unit)

    def instrument(self, name: str, channel: str) -> Quantity | None:
        """Return a property of the channel's instrument, None if it is not stated."""
        return instrument(self.specimen, name, channel, self.raw.units[channel])

    def shown(self, value: float, channel: str, digits: int = 3) -> str:
        return with_unit(float(value), self.raw.units[channel], channel, digits=digits)


def knows_prehistory(system: str, excitation: str) -> bool:
    """Whether experiments.csv can state that a system had settled under the first excitation."""
    try:
        conditions = system_class(system).conditions or {}
    except UserError:  # other checks report a wrong system name
        return False
    return "prehistory" in conditions.get(COMMANDS.get(excitation, excitation), {})


def value_before(row: ExperimentRow, system: str) -> float | None:
    """Excitation before the first sample: 0 for a voltage; None if as in the first sample.

    None applies to a stretch, and to a voltage if the row states equilibrium.
    """
    if COMMANDS.get(row.excitation, row.excitation) != "voltage":
        return None
    settled = row.metadata.get("prehistory") == "equilibrium"
    return None if settled and knows_prehistory(system, row.excitation) else 0.0


def is_near(first: float, before: float, excitation: FloatArray) -> bool:
    """Whether the first sample is close to the value before it, compared with the excitation."""
    return abs(first - before) <= NEAR * float(np.max(np.abs(excitation - before)))


def share_at(values: FloatArray, limit: float) -> float:
    """Share of the values that lie at the limit of their sensor."""
    return float(np.mean(np.abs(values) >= 0.999 * limit))


def least_swing(response: FloatArray) -> float:
    """Return a change clearly above noise: 2 % of the range or, if more, ten times the noise."""
    return max(SWING * float(np.ptp(response)), OVER_NOISE * white_noise(response))


def single_samples(response: FloatArray, swing: float) -> NDArray[np.intp]:
    """Indices of samples more than `swing` beyond both neighbours, with level samples behind.

    An oscillation is not level behind a peak.
    """
    padded = np.pad(response, (1, BEHIND), mode="edge")
    before = padded[: response.size]
    behind = np.array([padded[k : k + response.size] for k in range(2, 2 + BEHIND)])
    beyond = np.minimum(response - before, response - behind[0])
    below = np.minimum(before - response, behind[0] - response)
    height = np.maximum(beyond, below)
    return np.flatnonzero((height > swing) & (np.ptp(behind, axis=0) <= LEVEL * height))


def without_single_samples(response: FloatArray, swing: float) -> FloatArray:
    """Replace each of the `single_samples` by the mean of its neighbours."""
    outliers = single_samples(response, swing)
    mended = response.copy()
    mended[outliers] = 0.5 * (response[outliers - 1] + response[outliers + 1])
    return mended


def standing_out(
    excitation: FloatArray, excitation_range: float, response: FloatArray
) -> NDArray[np.intp]:
    """Single outlying samples of a response while the excitation is steady."""
    outliers = single_samples(response, least_swing(response))
    change = np.abs(np.diff(np.pad(excitation, (1, BEHIND), mode="edge")))
    moved = np.max([change[k : k + response.size] for k in range(BEHIND + 1)], axis=0)
    return outliers[moved[outliers] <= STEADY * excitation_range]


def glitches(excitation: FloatArray, response: FloatArray) -> NDArray[np.intp]:
    """Single outlying samples of an excitation that the response does not follow.

    The excitation has its previous level again after each. None are reported if the excitation
    often jumps as far, as random levels do.
    """
    outliers = single_samples(excitation, least_swing(excitation))
    before, behind = excitation[outliers - 1], excitation[outliers + 1]
    height = np.minimum(
        np.abs(excitation[outliers] - before), np.abs(excitation[outliers] - behind)
    )
    followed = _off_neighbours(response) > least_swing(response)
    alone = (np.abs(behind - before) <= LEVEL * height) & ~(
        followed[outliers] | followed[outliers + 1]
    )
    outliers, height = outliers[alone], height[alone]
    far = np.abs(np.diff(excitation)) > 0.5 * np.min(height, initial=np.inf)
    return outliers if far.sum() <= JUMPS * outliers.size else outliers[:0]


def _off_neighbours(values: FloatArray) -> FloatArray:
    """Distance of each sample from the mean of its neighbours."""
    return np.abs(np.pad(0.5 * np.diff(values, 2), 1))


def white_noise(values: FloatArray, order: int = 2) -> float:
    """Standard deviation of white noise, from differences of an order that remove a trend.

    The sum of squares of the coefficients of a difference of order n is (2n)! / n!^2.
    """
    differences = np.abs(np.diff(values, order))
    size = np.sqrt(float(math.comb(2 * order, order)))
    return float(1.4826 * np.median(differences) / size) if differences.size else 0.0


def response_jumps(
    excitation: FloatArray, excitation_range: float, response: FloatArray
) -> NDArray[np.intp]:
    """Samples at which a response has jumped while the excitation was steady.

    A jump exceeds `least_swing` and `USUAL` times the usual change of the response there. Single
    outlying samples and steps of a coarse display do not count.
    """
    change = np.abs(np.diff(response))
    if change.size < 2 * AROUND + 1 or not change.any():
        return np.empty(0, dtype=np.intp)
    swing = least_swing(response)
    least = max(swing, OF_RESOLUTION * float(np.min(change[change > 0.0])))
    around = np.pad(change, AROUND, mode="reflect")
    usual = np.median(sliding_window_view(around, 2 * AROUND + 1), axis=1)
    driven = _driven(excitation, excitation_range)
    jumps = np.flatnonzero((change > np.maximum(least, USUAL * usual)) & ~driven) + 1
    alone = single_samples(response, swing)
    return np.setdiff1d(jumps, np.concatenate([alone, alone + 1]))


def _driven(excitation: FloatArray, excitation_range: float) -> NDArray[np.bool_]:
    """Whether an excitation jumps, begins, stops or turns near each pair of samples."""
    moved = np.abs(np.diff(excitation)) > STEADY * excitation_range
    jumps = sliding_window_view(np.pad(moved, SETTLED), 2 * SETTLED + 1).any(axis=1)
    padded = np.pad(excitation, SETTLED, mode="edge")
    over = padded[SETTLED:] - padded[:-SETTLED]
    before, behind = over[:-SETTLED], over[SETTLED:]
    turns = np.abs(behind - before) > SAME_RATE * float(np.max(np.abs(over)))
    return np.asarray(jumps | turns[:-1] | turns[1:])


def dropouts(excitation: FloatArray, response: FloatArray) -> NDArray[np.intp]:
    """First samples of short dropouts of a held excitation that the response does not follow.

    `glitches` finds dropouts of a single sample.
    """
    swing, follows = least_swing(excitation), least_swing(response)
    jumped = np.flatnonzero(np.abs(np.diff(excitation)) > swing)
    starts = []
    for first, last in itertools.pairwise(jumped):
        away = excitation[first + 1 : last + 1]
        height = np.min(np.abs(away - excitation[first]))
        back = abs(excitation[last + 1] - excitation[first]) <= BACK * height
        near = response[first : last + 2]
        if 1 < away.size <= LONGEST and back and float(np.ptp(near)) <= follows:
            starts.append(first + 1)
    return np.array(starts, dtype=np.intp)
