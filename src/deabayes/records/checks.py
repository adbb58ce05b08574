"""Checks of one record. Each function returns sentences, or an empty list if all is well."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import rename_hint
from deabayes.prior.parameter import Parameter
from deabayes.quantities import with_unit
from deabayes.records.columns import CHANNELS
from deabayes.records.excitation import is_held
from deabayes.records.record import REMEDY

SMALLEST_RECORD = 4


def missing_columns(columns: Collection[str], needed: Iterable[str], where: str) -> list[str]:
    """Columns that the experiment needs and the record lacks."""
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
    """Missing, NaN or infinite values; `otherwise` names an alternative to repairing them."""
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
    """Repeated time stamps; `otherwise` as for `not_finite`."""
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
    """A constant channel: a dead sensor or the wrong column."""
    if np.ptp(values) > 1e-12 * np.max(np.abs(values)):
        return []
    return [
        f"{where}, column {channel}: is constant ({values[0]:g} in all {values.size} rows); "
        "check the sensor and the column named in experiments.csv"
    ]


def too_few_points(points: int, parameters: int, where: str) -> list[str]:
    """No more points than parameters."""
    if points > parameters:
        return []
    return [
        f"{where}: {points} points cannot determine {parameters} parameters; give more data or "
        "a smaller candidate"
    ]


def too_short(points: int, where: str) -> list[str]:
    """A record with too few rows."""
    if points >= SMALLEST_RECORD:
        return []
    return [
        f"{where}: holds {points} data rows, at least {SMALLEST_RECORD} are needed; the file may "
        "be truncated, copy it again"
    ]


def outside_range(
    values: FloatArray, limit: float, channel: str, unit: str, where: str, allowed: float = 1e-9
) -> list[str]:
    """Values outside the instrument's range by more than the share `allowed`."""
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
    """A response that varies by less than the standard deviation of its sensor's noise."""
    if np.ptp(values) >= noise or constant_channel(values, channel, where):
        return []  # `constant_channel` reports a constant response
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
    """A record shorter than the longest time constant expected by its prior."""
    if duration >= longest:
        return []
    return [f"{where}: lasts {duration:.3g} s, less than the longest time constant of the prior "
            f"({longest:.3g} s), which the prior will then set"]  # fmt: skip


def too_short_for(
    parameters: Iterable[Parameter], durations: Sequence[float], where: str
) -> list[str]:
    """Records all shorter than the longest time constant expected by the priors."""
    constants = [p for p in parameters if p.is_time_constant]
    if not constants or not durations:
        return []
    # The prior's upper quartile: half of its mass lies within a factor or so of it.
    longest = max(float(p.prior.from_normal(np.array(0.6745))) for p in constants)
    return shorter_than_time_constant(max(durations), longest, where)


Flags = NDArray[np.bool_]
MOSTLY = 0.5
"""Share of a record at its sensor's limit above which the record is unusable."""
QUANTISED = 0.5
"""Share of equal neighbours above which the steps of a record are coarser than its noise."""
HELD_ALIKE = 0.8
"""Share of readings held for the same number of samples above which a slower clock is assumed."""
FEWEST_HELD = 5
"""Number of successive equal samples at an extreme that noise cannot explain."""


def current_at_limit(current: FloatArray, limit: float, protocol: str, where: str) -> list[str]:
    """An amplifier that reaches its current limit."""
    share = float(np.mean(np.abs(current) >= 0.98 * limit))
    if share == 0.0:
        return []
    effect = (
        "the voltage is distorted" if protocol == "sine" else "the voltage rises slower than asked"
    )
    return [f"{where}: the amplifier is at its current limit of {with_unit(limit, 'A')} in "
            f"{share:.2%} of the record, so {effect}"]  # fmt: skip


def clipped_sensor(
    values: FloatArray, limit: float | None, channel: str, unit: str, where: str
) -> list[str]:
    """A sensor at the end of its range: values at the limit, or a flat top in a noisy record."""
    if limit is not None:
        share = float(np.mean(np.abs(values) >= 0.999 * limit))
        if share > 0.0:
            reach = with_unit(limit, unit, channel)
            return [f"{where}, column {channel}: {share:.2%} of the values lie at the sensor's "
                    f"range of {reach}, the sensor is clipped"]  # fmt: skip
    return [
        f"{where}, column {channel}: the {name} value {with_unit(end, unit, channel)} is held for "
        f"{run} samples in a row ({np.mean(values == end):.0%} of all), the sensor may be clipped"
        for name, end, run in _held_ends(values)
    ]


def mostly_clipped(
    values: FloatArray, limit: float | None, channel: str, unit: str, where: str
) -> list[str]:
    """Fault: a channel that is at its instrument's limit for most of the record."""
    share = 0.0 if limit is None else float(np.mean(np.abs(values) >= 0.999 * limit))
    if limit is None or share <= MOSTLY:
        return []
    return [
        f"{where}, column {channel}: {share:.0%} of the values lie at the sensor's range of "
        f"{with_unit(limit, unit, channel)}; record it with a wider range, or cut the record there"
    ]


def _held_ends(values: FloatArray) -> Iterator[tuple[str, float, int]]:
    """Yield extremes at which noisy values stay constant, with the longest run of each."""
    for name, end in (("largest", np.max(values)), ("smallest", np.min(values))):
        held = values == end
        if _equal_neighbours(values, held) > QUANTISED:
            continue  # coarse steps make plateaus by themselves
        run = longest_run(_without_start_at_rest(values, held))
        if run >= FEWEST_HELD:
            yield name, float(end), run


def _equal_neighbours(values: FloatArray, left_out: Flags) -> float:
    """Share of equal neighbouring samples, without pairs that are both `left_out` (M,)."""
    equal = np.diff(values)[~(left_out[1:] & left_out[:-1])] == 0.0
    return float(np.mean(equal)) if equal.size else 0.0


def _without_start_at_rest(values: FloatArray, held: Flags) -> Flags:
    """Remove from `held` (M,) the run at rest that begins a noise-free record.

    With noise, differences between neighbours change sign in two of three places, and a sensor
    at rest does not stand still.
    """
    moved = np.cumsum(~held) > 0
    steps = np.diff(values[moved])
    signs = np.sign(steps[steps != 0.0])
    noisy = signs.size < 2 or np.mean(signs[1:] != signs[:-1]) > 0.4
    return held if noisy else held & moved


def coarse_quantisation(
    values: FloatArray,
    resolution: float | None,
    noise: float | None,
    channel: str,
    unit: str,
    where: str,
) -> list[str]:
    """Quantisation coarser than the noise: as stated, or seen in equal neighbours.

    Equal neighbours at an extreme where the sensor may be clipped do not count.
    """
    if resolution is not None and noise is not None and resolution > noise:
        return [f"{where}, column {channel}: the resolution "
                f"{with_unit(resolution, unit, channel)} is coarser than the noise "
                f"{with_unit(noise, unit, channel)}"]  # fmt: skip
    if held := samples_held(values):
        return [f"{where}, column {channel}: changes every {held} samples only: it was read more "
                "seldom than it was written, and what is held lags; keep the samples at which it "
                f"changes (`decimate: {{every: {held}}}` first in `preparation`)"]  # fmt: skip
    share = _equal_neighbours(values, np.isin(values, [end for _, end, _ in _held_ends(values)]))
    if share <= QUANTISED:
        return []
    steps = np.diff(np.unique(values))
    step = float(np.min(steps)) if steps.size else 0.0
    seen = with_unit(step, unit, channel, digits=3)
    return [f"{where}, column {channel}: quantised in steps of {seen}, coarser than the noise "
            f"({share:.0%} of neighbouring samples are equal)"]  # fmt: skip


def samples_held(values: FloatArray) -> int:
    """Number of samples for which each reading is held; 0 if readings are not held equally long."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    if changes.size < FEWEST_HELD:
        return 0
    lengths = np.diff(changes)
    usual = int(np.median(lengths))
    alike = float(np.mean(lengths == usual))
    return usual if usual >= 2 and alike > HELD_ALIKE else 0


def longest_run(flags: Flags) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


STATED = ("voltage_kV", "amplitude_kV", "bias_kV")
UNIT_FACTOR = 30.0
"""Two voltages with a larger ratio have different units; kV and V differ by 1000."""


def unknown_voltage(columns: Collection[str], metadata: Collection[str], where: str) -> list[str]:
    """A pull on an actuator without a stated voltage."""
    if "voltage" in columns or "voltage_kV" in metadata:
        return []
    return [
        f"{where}: the voltage during the pull is not known; give a column 'voltage [kV]', or "
        "voltage_kV in experiments.csv (0 without voltage)"
    ]


def voltage_not_held(voltage: FloatArray, where: str) -> list[str]:
    """A voltage [V] that varies during a pull by more than 1 % or a monitor's noise."""
    faults = not_finite(voltage, "voltage", where)
    if faults or is_held(voltage):
        return faults
    return [
        f"{where}, column voltage: varies from {voltage.min():g} to {voltage.max():g} V during the "
        "pull; give one record per voltage"
    ]


def voltage_no_number(stated: float | str, where: str) -> list[str]:
    """A voltage in experiments.csv that is not a number."""
    if not isinstance(stated, str) and np.isfinite(stated):
        return []
    return [
        f"{where}: voltage_kV is {stated!r} in experiments.csv; give a number in kV (0 without "
        "voltage), or a column 'voltage [kV]' in the record"
    ]


def voltage_in_another_unit(
    size: float, column: str, stated: float | str | None, where: str
) -> list[str]:
    """A record's voltage, `size` [V], that contradicts `column` of experiments.csv [kV]."""
    if not isinstance(stated, float) or not stated > 0.0 or np.isnan(size):
        return []
    if 1.0 / UNIT_FACTOR <= size / (1000.0 * stated) <= UNIT_FACTOR:
        return []
    return [
        f"{where}, column voltage: comes to {size:g} V where experiments.csv says {column} "
        f"{stated:g}; correct the column's unit, or {column}"
    ]


def stated_beyond_range(metadata: Mapping[str, float | str], limit: float, where: str) -> list[str]:
    """Voltages in experiments.csv [kV] beyond the amplifier's range `limit` [V]."""
    stated = {name: metadata.get(name) for name in STATED}
    return [
        f"{where}: {name} is {value:g} in experiments.csv, beyond the voltage's range of "
        f"{with_unit(limit, 'V')} in specimen.yaml; give it in kV, or correct the range"
        for name, value in stated.items()
        if isinstance(value, float) and 1000.0 * abs(value) > limit * (1.0 + 1e-9)
    ]
