"""Tiny checks of one record's values. Each returns sentences: none if all is well.

`where` names the file and the experiment. Rows are data rows, counted from 1
after the header.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import rename_hint
from deabayes.parameter import Parameter
from deabayes.quantities import with_unit
from deabayes.reading.columns import CHANNELS
from deabayes.reading.incomplete import REMEDY

SMALLEST_RECORD = 4


def missing_columns(columns: Collection[str], needed: Iterable[str], where: str) -> list[str]:
    """Columns that the experiment names and the record lacks."""
    if not columns:
        return [
            f"{where}: no column has a unit; write 'time [s]' and so on in the header, or give "
            "`unit` under record_format.columns in specimen.yaml"
        ]
    needed = list(needed)
    unknown = [name for name in columns if name not in (*needed, *CHANNELS)]
    return [
        f"{where}: column {name!r} is missing; the record has {', '.join(columns)}"
        f"{rename_hint(name, unknown) or '; correct the header or experiments.csv'}"
        for name in needed
        if name not in columns
    ]


def not_finite(
    values: FloatArray, channel: str, where: str, otherwise: str = f", {REMEDY}"
) -> list[str]:
    """NaN, infinite or missing values; `otherwise` is what else can be done than to mend them."""
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size == 0:
        return []
    if bad.size == values.size > 1:
        return [f"{where}, column {channel}: holds no value in any of its {bad.size} rows; name "
                "the column that holds the measurement, or have it exported again"]  # fmt: skip
    run = int(np.argmin(np.append(np.diff(bad) == 1, False))) + 1
    return [
        f"{where}, column {channel}: values missing, NaN or infinite: {bad.size}, the first in "
        f"data row {bad[0] + 1} (a run of {run}); repair the record or cut it there{otherwise}"
    ]


def time_goes_back(time: FloatArray, where: str) -> list[str]:
    """Time that decreases."""
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size == 0:
        return []
    row = int(back[0]) + 2
    return [
        f"{where}, column time: goes back at data row {row}, from {time[row - 2]:.9g} s to "
        f"{time[row - 1]:.9g} s ({back.size} such rows); sort the rows or remove the wrong ones"
    ]


def time_repeats(time: FloatArray, where: str, otherwise: str = f", {REMEDY}") -> list[str]:
    """Time stamps given twice; `otherwise` as for `not_finite`."""
    same = np.flatnonzero(np.diff(time) == 0.0)
    if same.size == 0:
        return []
    row = int(same[0]) + 2
    return [
        f"{where}, column time: data row {row} repeats the time {time[row - 1]:.9g} s of the row "
        f"before ({same.size} such rows); remove the duplicates or give time more "
        f"digits{otherwise}"
    ]


def constant_channel(values: FloatArray, channel: str, where: str) -> list[str]:
    """A channel that never changes: a dead sensor or the wrong column."""
    if np.ptp(values) > 1e-12 * np.max(np.abs(values)):
        return []
    return [
        f"{where}, column {channel}: is constant ({values[0]:g} in all {values.size} rows); "
        "check the sensor and the column named in experiments.csv"
    ]


def too_few_points(points: int, parameters: int, where: str) -> list[str]:
    """Fewer points than parameters, or hardly any."""
    if points > parameters:
        return []
    return [
        f"{where}: {points} points cannot determine {parameters} parameters; give more data or "
        "a smaller candidate"
    ]


def too_short(points: int, where: str) -> list[str]:
    """A record of hardly any rows."""
    if points >= SMALLEST_RECORD:
        return []
    return [
        f"{where}: holds {points} data rows, at least {SMALLEST_RECORD} are needed; the file may "
        "be truncated, copy it again"
    ]


def outside_range(
    values: FloatArray, limit: float, channel: str, unit: str, where: str, allowed: float = 1e-9
) -> list[str]:
    """Values further beyond what the channel's instrument can do than the share `allowed`."""
    beyond = np.flatnonzero(np.abs(values) > limit * (1.0 + allowed))
    if beyond.size == 0:
        return []
    row, worst = int(beyond[0]) + 1, float(values[np.argmax(np.abs(values))])
    return [
        f"{where}, column {channel}: reaches {with_unit(worst, unit, channel)}, beyond the "
        f"instrument's range of {with_unit(limit, unit, channel)} (first in data row {row}); "
        "correct the column's unit or the range in specimen.yaml"
    ]


def less_than_noise(
    values: FloatArray, noise: float, channel: str, unit: str, where: str
) -> list[str]:
    """A response that varies by less than the sd of its sensor's noise, which no noise does."""
    if np.ptp(values) >= noise or constant_channel(values, channel, where):
        return []  # a constant one is said to be so, whatever its unit
    return [
        f"{where}, column {channel}: varies by {np.ptp(values):.4g} {unit}, less than the noise of "
        f"{noise:.4g} {unit} in specimen.yaml; correct the unit of one of them"
    ]


REMEDIES = {
    "stretch": "a strain becomes a stretch with `offset: 1` in record_format",
    "gain": "it is a ratio of amplitudes, no decibels, and its sign belongs to the phase",
}


def not_positive(values: FloatArray, channel: str, where: str) -> list[str]:
    """A stretch, area, frequency or gain that is zero or negative."""
    wrong = np.flatnonzero(values <= 0.0)
    if wrong.size == 0:
        return []
    return [
        f"{where}, column {channel}: is {values[wrong[0]]:g} in data row {wrong[0] + 1}, must be "
        f"positive; {REMEDIES.get(channel, 'correct or remove the row')}"
    ]


def sampling_jitter(time: FloatArray, where: str) -> list[str]:
    """Uneven sampling and gaps."""
    intervals = np.diff(time)
    usual = float(np.median(intervals))
    sentences = []
    longest = int(np.argmax(intervals))
    if intervals[longest] > 10.0 * usual:
        sentences.append(f"{where}: a gap of {intervals[longest]:.3g} s after "
                         f"{time[longest]:.6g} s (usual interval {usual:.3g} s)")  # fmt: skip
    share = float(np.mean(np.abs(intervals - usual) > 0.2 * usual))
    if share > 0.01:
        sentences.append(f"{where}: sampling jitter, {share:.0%} of the intervals differ from "
                         f"{usual:.3g} s by more than 20 %")  # fmt: skip
    return sentences


def shorter_than_time_constant(duration: float, longest: float, where: str) -> list[str]:
    """A record shorter than the longest time constant that its prior allows."""
    if duration >= longest:
        return []
    return [f"{where}: lasts {duration:.3g} s, less than the longest time constant of the prior "
            f"({longest:.3g} s), which the prior will then set"]  # fmt: skip


def too_short_for(
    parameters: Iterable[Parameter], durations: Sequence[float], where: str
) -> list[str]:
    """No record outlasts the longest of the ordered time constants that the priors expect."""
    constants = [p for p in parameters if p.is_time_constant]
    if not constants or not durations:
        return []
    # The prior's upper quartile: half of its mass lies within a factor or so of it.
    longest = max(float(p.prior.from_normal(np.array(0.6745))) for p in constants)
    return shorter_than_time_constant(max(durations), longest, where)
