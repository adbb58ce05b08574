"""Checks of one record: what a user must correct, and what a user must know."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Quantity, Specimen
from deabayes.faults import Report, rename_hint
from deabayes.integrate.periodic import alike, passes, usual_period
from deabayes.quantities import with_unit
from deabayes.records.channels import (
    STEPS,
    dropouts,
    excitation_range,
    glitches,
    is_held,
    is_near,
    is_step_from_the_start,
    knows_prehistory,
    response_jumps,
    standing_out,
    usual_interval,
    value_before,
)
from deabayes.records.columns import CHANNELS, COMMANDS, ExperimentRow, RawRecord
from deabayes.records.record import REMEDY
from deabayes.records.table import WITHOUT_TIME, channels_of, measured_rows
from deabayes.systems.specimen_quantities import instrument

Flags = NDArray[np.bool_]
SMALLEST_RECORD = 4
POSITIVE = ("stretch", "area", "frequency", "gain")
REMEDIES = {
    "stretch": "a strain becomes a stretch with `offset: 1` in record_format",
    "gain": "it is a ratio of amplitudes, no decibels, and its sign belongs to the phase",
}
FEWEST_SWINGS, PULSES = 4, 0.7
"""Fewest evenly spaced swings that are no step. Second, the share of a record near the ends of
its range above which it is pulses; for a sine the share is 0.41."""
HELD = 0.02
"""Largest change of the excitation in a hold, as a share of its distance from rest."""
BEYOND_SENSOR, BEYOND_AMPLIFIER = 0.05, 1e-9
"""Shares by which a channel may exceed its stated range: a clipped sensor, and the rest. More
suggests another unit."""
MOSTLY = 0.5
"""Share of a record at its sensor's limit above which the record is unusable."""
QUANTISED = 0.5
"""Share of equal neighbours above which the steps of a record are coarser than its noise."""
HELD_ALIKE = 0.8
"""Share of readings held for the same number of samples above which a slower clock is assumed."""
FEWEST_HELD = 5
"""Number of successive equal samples at an extreme that noise cannot explain."""
STATED = ("voltage_kV", "amplitude_kV", "bias_kV")
UNIT_FACTOR = 30.0
"""Two voltages with a larger ratio have different units; kV and V differ by 1000."""
WITHIN = 0.25
"""Largest relative error of a stated value; the requested and the real value may differ."""
FEWEST_PASSES = 3
PER_PERIOD = 4.0
"""Fewest samples per period; with only two, a sine can look like another one."""
RAMPED, FEWEST_SAMPLES = ("relaxation", "load_unload"), 3
"""Protocols whose excitation begins with one ramp, and the fewest samples for its rate."""


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


def needed_columns(row: ExperimentRow) -> tuple[str, ...]:
    """Columns that the experiment cannot do without."""
    time = () if row.protocol in WITHOUT_TIME else ("time",)
    return tuple(dict.fromkeys((*time, row.excitation, row.response)))


def check_record(row: ExperimentRow, raw: RawRecord, specimen: Specimen, place: str) -> Report:
    """Report every fault of one record or, if it has none, every warning.

    Checks that earlier faults make meaningless are left out.

    Parameters
    ----------
    place : the file and the experiment, for the messages.
    """
    check = Check(row, raw, specimen, Report(place))
    missing_columns(check)
    if not check.report.faults:
        _check_completeness(check)
    if not check.report.faults:
        _check_values(check)
    if not check.report.faults:
        _warn(check)
    return check.report


def checked(
    row: ExperimentRow, raw: RawRecord, specimen: Specimen, path: Path | str | None = None
) -> RawRecord:
    """Return a record without faults, with the warnings on each experiment that it holds.

    The warnings name the file as experiments.csv does, because prepared records keep them.

    Parameters
    ----------
    path : where the file is, for messages; default as in experiments.csv.

    Raises
    ------
    Faults : every fault of every experiment.
    """
    path, report = str(path or row.record), Report()
    warnings = {}
    for measured in measured_rows(row, raw):
        found = check_record(measured, raw, specimen, f"{path} ({row.name})")
        report.include(found.faults)
        warnings[measured.name] = tuple(
            f"{row.record}{warning.removeprefix(path)}" for warning in found.warnings
        )
    report.raise_faults()
    return replace(raw, warnings=warnings)


def _check_completeness(check: Check) -> None:
    """Report missing rows and values, and a pull's voltage that is unknown or not constant."""
    rows = check.response.size
    if rows < SMALLEST_RECORD:
        check.report.fault(
            f"holds {rows} data rows, at least {SMALLEST_RECORD} are needed; the file may be "
            "truncated, copy it again"
        )
    if check.is_pull:
        _check_voltage_of_pull(check)
    for name in needed_columns(check.row):
        not_finite(check.report, check.raw.columns[name], name)


def _check_values(check: Check) -> None:
    """Report impossible values, and values that contradict the row or the instruments."""
    row, report = check.row, check.report
    if check.in_time:
        time_goes_back(report, check.time)
        time_repeats(report, check.time)
    has_ramp = not _hold_without_its_ramp(check)
    for name in (row.excitation, row.response):
        values = check.raw.columns[name]
        on_from_the_start = name == row.excitation and check.is_step_from_the_start
        if has_ramp and not on_from_the_start:
            constant_channel(report, values, name)
        if name in POSITIVE:
            not_positive(report, values, name)
    _check_stated_voltages(check)
    _check_ranges(check)
    _sine_called_a_step(check)
    if not report.faults:
        _check_stated_values(check)
    noise = check.instrument("noise", row.response)
    if noise is not None:
        less_than_noise(report, check.response, noise, row.response)


def missing_columns(check: Check) -> None:
    """Report columns that the experiment needs and the record lacks."""
    columns, needed = check.raw.columns, needed_columns(check.row)
    if not columns:
        check.report.fault(
            "no column has a unit; write 'time [s]' and so on in the header, or give `unit` under "
            "record_format.columns in specimen.yaml"
        )
        return
    unknown = [name for name in columns if name not in (*needed, *CHANNELS)]
    for name in needed:
        if name not in columns:
            remedy = rename_hint(name, unknown) or "; correct the header or experiments.csv"
            have = ", ".join(columns)
            check.report.fault(f"column {name!r} is missing; the record has {have}{remedy}")


def not_finite(
    report: Report, values: FloatArray, channel: str, otherwise: str = f", {REMEDY}"
) -> None:
    """Report missing, NaN or infinite values; `otherwise` is an alternative to repairing them."""
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size == 0:
        return
    if bad.size == values.size > 1:
        report.fault(
            f"holds no value in any of its {bad.size} rows; name the column that holds the "
            "measurement, or have it exported again",
            f"column {channel}",
        )
        return
    run = int(np.argmin(np.append(np.diff(bad) == 1, False))) + 1
    report.fault(
        f"values missing, NaN or infinite: {bad.size}, the first in data row {bad[0] + 1} (a run "
        f"of {run}); repair the record or cut it there{otherwise}",
        f"column {channel}",
    )


def time_goes_back(report: Report, time: FloatArray) -> None:
    """Report time that decreases."""
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size:
        row = int(back[0]) + 2
        report.fault(
            f"goes back at data row {row}, from {time[row - 2]:.9g} s to {time[row - 1]:.9g} s "
            f"({back.size} such rows); sort the rows or remove the wrong ones",
            "column time",
        )


def time_repeats(report: Report, time: FloatArray, otherwise: str = f", {REMEDY}") -> None:
    """Report repeated time stamps; `otherwise` as for `not_finite`."""
    same = np.flatnonzero(np.diff(time) == 0.0)
    if same.size:
        row = int(same[0]) + 2
        report.fault(
            f"data row {row} repeats the time {time[row - 1]:.9g} s of the row before "
            f"({same.size} such rows); remove the duplicates or give time more digits{otherwise}",
            "column time",
        )


def _is_constant(values: FloatArray) -> bool:
    return bool(np.ptp(values) <= 1e-12 * np.max(np.abs(values)))


def constant_channel(report: Report, values: FloatArray, channel: str) -> None:
    """Report a constant channel: a dead sensor or the wrong column."""
    if _is_constant(values):
        report.fault(
            f"is constant ({values[0]:g} in all {values.size} rows); check the sensor and the "
            "column named in experiments.csv",
            f"column {channel}",
        )


def not_positive(report: Report, values: FloatArray, channel: str) -> None:
    """Report a stretch, area, frequency or gain that is zero or negative."""
    wrong = np.flatnonzero(values <= 0.0)
    if wrong.size:
        remedy = REMEDIES.get(channel, "correct or remove the row")
        report.fault(
            f"is {values[wrong[0]]:g} in data row {wrong[0] + 1}, must be positive; {remedy}",
            f"column {channel}",
        )


def less_than_noise(report: Report, values: FloatArray, noise: Quantity, channel: str) -> None:
    """Report a response that varies by less than the standard deviation of its noise."""
    size = float(np.ptp(values))
    if size < noise.value and not _is_constant(values):  # `constant_channel` reports a constant
        report.fault(
            f"varies by {size:.4g} {noise.unit}, less than the noise of {noise.value:.4g} "
            f"{noise.unit} in specimen.yaml; correct the unit of one of them",
            f"column {channel}",
        )


def outside_range(
    report: Report, values: FloatArray, limit: Quantity, channel: str, allowed: float
) -> None:
    """Report values outside the instrument's range by more than the share `allowed`."""
    beyond = np.flatnonzero(np.abs(values) > limit.value * (1.0 + allowed))
    if beyond.size:
        worst = float(values[np.argmax(np.abs(values))])
        report.fault(
            f"reaches {with_unit(worst, limit.unit, channel)}, beyond the instrument's range of "
            f"{with_unit(limit.value, limit.unit, channel)} (first in data row {beyond[0] + 1}); "
            "correct the column's unit or the range in specimen.yaml",
            f"column {channel}",
        )


def _check_ranges(check: Check) -> None:
    """Report channels that exceed their range, and a response that is mostly at its limit."""
    row = check.row
    allowed = {row.excitation: BEYOND_AMPLIFIER, row.response: BEYOND_SENSOR}
    if check.is_pull and "voltage" in check.raw.columns:
        allowed["voltage"] = BEYOND_SENSOR
    for name, share in allowed.items():
        limit = check.instrument("range", name)
        if limit is not None:
            outside_range(check.report, check.raw.columns[name], limit, name, share)
    limit = check.instrument("range", row.response)
    at_limit = 0.0 if limit is None else _share_at(check.response, limit.value)
    if limit is not None and at_limit > MOSTLY:
        check.report.fault(
            f"{at_limit:.0%} of the values lie at the sensor's range of "
            f"{check.shown(limit.value, row.response, 6)}; record it with a wider range, or cut "
            "the record there",
            f"column {row.response}",
        )


def _share_at(values: FloatArray, limit: float) -> float:
    """Share of the values that lie at the limit of their sensor."""
    return float(np.mean(np.abs(values) >= 0.999 * limit))


def _sine_called_a_step(check: Check) -> None:
    """Report a creep or step whose excitation swings like a sine; pulses stay at their ends."""
    row, driven = check.row, check.excitation
    if row.protocol not in STEPS:
        return
    times = passes(check.time, driven)
    place = (driven - driven.min()) / (float(np.ptp(driven)) or 1.0)
    at_ends = float(np.mean(np.abs(place - 0.5) > 0.4))
    if times.size >= FEWEST_SWINGS and alike(times).all() and at_ends <= PULSES:
        check.report.fault(
            f"is called a {row.protocol}, but its {row.excitation} swings {times.size} times at "
            "even distances; if it is a sine, set its protocol to sine"
        )


def _hold_without_its_ramp(check: Check) -> bool:
    """Report a relaxation without its ramp: the model would take the strip for relaxed."""
    name = check.row.excitation
    if check.row.protocol != "relaxation" or name not in ("stretch", "displacement"):
        return False
    departure = np.abs(check.excitation - (1.0 if name == "stretch" else 0.0))
    if float(np.ptp(check.excitation)) > HELD * float(departure.max()):
        return False
    check.report.fault(
        "is constant or hardly changes; a relaxation needs the ramp that led to it, on which the "
        "stress depends: add its rows",
        f"column {name}",
    )
    return True


def _check_voltage_of_pull(check: Check) -> None:
    """Report the voltage of a pull if it varies, is no number, or is missing for an actuator.

    It may vary by 1 % or a monitor's noise.
    """
    report, stated = check.report, check.row.metadata.get("voltage_kV")
    if "voltage" in check.raw.columns:
        voltage = check.raw.columns["voltage"]
        not_finite(report, voltage, "voltage")
        if np.isfinite(voltage).all() and not is_held(voltage):
            report.fault(
                f"varies from {voltage.min():g} to {voltage.max():g} V during the pull; give one "
                "record per voltage",
                "column voltage",
            )
    elif stated is not None:
        if isinstance(stated, str) or not np.isfinite(stated):
            report.fault(
                f"voltage_kV is {stated!r} in experiments.csv; give a number in kV (0 without "
                "voltage), or a column 'voltage [kV]' in the record"
            )
    elif (
        check.specimen.system
        and "voltage" in channels_of(check.specimen.system, check.row.protocol)[0]
    ):
        report.fault(
            "the voltage during the pull is not known; give a column 'voltage [kV]', or "
            "voltage_kV in experiments.csv (0 without voltage)"
        )


def _check_stated_voltages(check: Check) -> None:
    """Report voltages of experiments.csv that contradict the record or, without it, the range."""
    stated = {name: check.row.metadata.get(name) for name in STATED}
    if "voltage" not in check.raw.columns or check.row.protocol == "frequency_response":
        limit = instrument(check.specimen, "range", "voltage", "V")
        for name, value in stated.items():
            if (
                limit
                and isinstance(value, float)
                and 1000.0 * abs(value) > limit.value * (1 + 1e-9)
            ):
                check.report.fault(
                    f"{name} is {value:g} in experiments.csv, beyond the voltage's range of "
                    f"{with_unit(limit.value, 'V')} in specimen.yaml; give it in kV, or correct "
                    "the range"
                )
        return
    voltage = check.raw.columns["voltage"]
    largest, half = float(np.max(np.abs(voltage))), float(np.ptp(voltage)) / 2.0
    if largest == 0.0 and check.row.excitation == "voltage":
        return  # `constant_channel` reports it
    sizes = {"voltage_kV": largest, "amplitude_kV": half}
    if check.row.excitation == "voltage" and check.is_step_from_the_start:
        del sizes["amplitude_kV"]
    for name, size in sizes.items():
        value = stated[name]
        if not isinstance(value, float) or not value > 0.0 or np.isnan(size):
            continue
        if not 1.0 / UNIT_FACTOR <= size / (1000.0 * value) <= UNIT_FACTOR:
            check.report.fault(
                f"comes to {size:g} V where experiments.csv says {name} {value:g}; correct the "
                f"column's unit, or {name}",
                "column voltage",
            )
            return


def _check_stated_values(check: Check) -> None:
    """Report a stated frequency, rate, amplitude or duration that contradicts the record.

    Typical causes are a time in milliseconds, a sine sampled too slowly, or another unit.
    """
    row = check.row
    if "time" not in check.raw.columns or check.is_step_from_the_start or _too_seldom(check):
        return
    for name, (unit, value) in STATED_VALUES.items():
        stated = row.metadata.get(name)
        if not isinstance(stated, int | float) or not 0.0 < stated < np.inf:
            continue
        measured = value(check)
        if measured is not None and abs(measured / stated - 1.0) > WITHIN:
            check.report.fault(
                f"{name} of experiments.csv is {stated:g}, but the record has "
                f"{with_unit(measured, unit, digits=3)}; correct the one that is wrong: the row, "
                f"or the unit of the record's time or {row.excitation}"
            )
            return


def _too_seldom(check: Check) -> bool:
    """Report a sine with so few samples per period that it may be another one."""
    stated = check.row.metadata.get("frequency_Hz")
    interval = usual_interval(check.time)
    if check.row.protocol != "sine" or not isinstance(stated, int | float) or stated <= 0.0:
        return False
    if 1.0 / stated >= PER_PERIOD * interval:
        return False
    check.report.fault(
        f"frequency_Hz of experiments.csv is {stated:g}, but the record has a sample only every "
        f"{with_unit(interval, 's', digits=3)}: fewer than {PER_PERIOD:g} a period cannot show "
        "that frequency; record it faster, or correct the row or the unit of time"
    )
    return True


def _frequency(check: Check) -> float | None:
    times = passes(check.time, check.excitation) if check.row.protocol == "sine" else np.empty(0)
    return 1.0 / float(usual_period(times)) if times.size >= FEWEST_PASSES else None


def _rate(check: Check) -> float | None:
    """Stretch rate between a tenth and nine tenths of the largest departure."""
    name, gauge = check.row.excitation, check.specimen.quantities.get("gauge_length")
    if check.row.protocol not in RAMPED or name not in ("stretch", "displacement"):
        return None
    length = 1.0 if name == "stretch" else gauge and gauge.value
    gone = np.abs(check.excitation - check.excitation[0])
    low, high = (int(np.argmax(gone >= share * gone.max())) for share in (0.1, 0.9))
    if not length or high - low < FEWEST_SAMPLES:
        return None
    return float(gone[high] - gone[low]) / float(check.time[high] - check.time[low]) / length


def _amplitude(check: Check) -> float | None:
    is_driven = check.row.excitation == "voltage" and check.row.protocol == "sine"
    return 0.5 * float(np.ptp(check.excitation)) / 1e3 if is_driven else None


STATED_VALUES: Mapping[str, tuple[str, Callable[[Check], float | None]]] = {
    "frequency_Hz": ("Hz", _frequency),
    "stretch_rate_per_s": ("1/s", _rate),
    "amplitude_kV": ("kV", _amplitude),
    "duration_s": ("s", lambda check: float(np.ptp(check.time))),
}
"""Column of experiments.csv -> its unit, and a function for its value in the record."""


def _warn(check: Check) -> None:
    """Warn of what a user must know before trusting a record without faults."""
    row, raw, report = check.row, check.raw, check.report
    limit, resolution, noise = (
        check.instrument(name, row.response) for name in ("range", "resolution", "noise")
    )
    unit = raw.units[row.response]
    clipped_sensor(report, check.response, limit, row.response, unit)
    coarse_quantisation(report, check.response, resolution, noise, row.response, unit)
    if raw.left_out:
        report.warn(
            f"{raw.left_out} of {raw.left_out + check.response.size} data rows are left out, "
            "without a value or at a repeated time (record_format.incomplete_rows)"
        )
    if check.in_time:
        sampling_jitter(report, check.time)
        _single_samples(check)
        _jumps(check)
    _beginning(check)
    if row.excitation in COMMANDS:
        report.warn(
            f"{row.excitation} is a command to the amplifier and is used as its output; if the "
            "amplifier could not follow it, begin the preparation with limit_current"
        )
    limit = instrument(check.specimen, "current_limit", "current", "A")
    if limit is not None and "current" in raw.columns:
        current_at_limit(report, raw.columns["current"], limit.value, row.protocol)


def sampling_jitter(report: Report, time: FloatArray) -> None:
    """Warn of uneven sampling and gaps."""
    intervals, usual = np.diff(time), usual_interval(time)
    longest = int(np.argmax(intervals))
    if intervals[longest] > 10.0 * usual:
        report.warn(
            f"a gap of {intervals[longest]:.3g} s after {time[longest]:.6g} s (usual interval "
            f"{usual:.3g} s)"
        )
    share = float(np.mean(np.abs(intervals - usual) > 0.2 * usual))
    if share > 0.01:
        report.warn(
            f"sampling jitter, {share:.0%} of the intervals differ from {usual:.3g} s by more "
            "than 20 %"
        )


def current_at_limit(report: Report, current: FloatArray, limit: float, protocol: str) -> None:
    """Warn of an amplifier that reaches its current limit."""
    share = float(np.mean(np.abs(current) >= 0.98 * limit))
    if share > 0.0:
        sine = protocol == "sine"
        effect = "is distorted" if sine else "rises slower than asked"
        report.warn(
            f"the amplifier is at its current limit of {with_unit(limit, 'A')} in {share:.2%} of "
            f"the record, so the voltage {effect}"
        )


def clipped_sensor(
    report: Report, values: FloatArray, limit: Quantity | None, channel: str, unit: str
) -> None:
    """Warn of a sensor at the end of its range: values at the limit, or a flat top with noise."""
    share = 0.0 if limit is None else _share_at(values, limit.value)
    if limit is not None and share > 0.0:
        report.warn(
            f"{share:.2%} of the values lie at the sensor's range of "
            f"{with_unit(limit.value, unit, channel)}, the sensor is clipped",
            f"column {channel}",
        )
    for name, end, run in () if limit is not None else _held_ends(values):
        report.warn(
            f"the {name} value {with_unit(end, unit, channel)} is held for {run} samples in a row "
            f"({np.mean(values == end):.0%} of all), the sensor may be clipped",
            f"column {channel}",
        )


def _held_ends(values: FloatArray) -> Iterator[tuple[str, float, int]]:
    """Yield extremes at which noisy values stay constant, with the longest run of each."""
    for name, end in (("largest", np.max(values)), ("smallest", np.min(values))):
        at_end = values == end
        if _equal_neighbours(values, at_end) > QUANTISED:
            continue  # coarse steps make plateaus by themselves
        run = _longest_run(_without_start_at_rest(values, at_end))
        if run >= FEWEST_HELD:
            yield name, float(end), run


def _equal_neighbours(values: FloatArray, left_out: Flags) -> float:
    """Share of equal neighbouring samples, without pairs that are both `left_out` (M,)."""
    equal = np.diff(values)[~(left_out[1:] & left_out[:-1])] == 0.0
    return float(np.mean(equal)) if equal.size else 0.0


def _without_start_at_rest(values: FloatArray, at_end: Flags) -> Flags:
    """Remove from `at_end` (M,) the run at rest that begins a noise-free record.

    With noise, differences between neighbours change sign in two of three places, and a sensor
    at rest does not stand still.
    """
    moved = np.cumsum(~at_end) > 0
    steps = np.diff(values[moved])
    signs = np.sign(steps[steps != 0.0])
    noisy = signs.size < 2 or np.mean(signs[1:] != signs[:-1]) > 0.4
    return at_end if noisy else at_end & moved


def _longest_run(flags: Flags) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def coarse_quantisation(
    report: Report,
    values: FloatArray,
    resolution: Quantity | None,
    noise: Quantity | None,
    channel: str,
    unit: str,
) -> None:
    """Warn of quantisation coarser than the noise: as stated, or seen in equal neighbours.

    Equal neighbours at an extreme where the sensor may be clipped do not count.
    """
    if resolution is not None and noise is not None and resolution.value > noise.value:
        report.warn(
            f"the resolution {with_unit(resolution.value, unit, channel)} is coarser than the "
            f"noise {with_unit(noise.value, unit, channel)}",
            f"column {channel}",
        )
        return
    if every := _samples_per_reading(values):
        report.warn(
            f"changes every {every} samples only: the sensor was read more seldom than the file "
            "was written, and the repeated values lag; keep the samples at which it changes "
            f"(`decimate: {{every: {every}}}` first in `preparation`)",
            f"column {channel}",
        )
        return
    share = _equal_neighbours(values, np.isin(values, [end for _, end, _ in _held_ends(values)]))
    if share > QUANTISED:
        step = float(np.min(np.diff(np.unique(values)), initial=np.inf))
        shown = with_unit(step if np.isfinite(step) else 0.0, unit, channel, digits=3)
        report.warn(
            f"quantised in steps of {shown}, coarser than the noise ({share:.0%} of neighbouring "
            "samples are equal)",
            f"column {channel}",
        )


def _samples_per_reading(values: FloatArray) -> int:
    """Number of samples for which each reading is held; 0 if readings are not held equally long."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    if changes.size < FEWEST_HELD:
        return 0
    lengths = np.diff(changes)
    usual = int(np.median(lengths))
    same = float(np.mean(lengths == usual))
    return usual if usual >= 2 and same > HELD_ALIKE else 0


def _beginning(check: Check) -> None:
    """Warn if a jump is assumed at the first sample because the record does not show it."""
    name, values, system = check.row.excitation, check.excitation, check.specimen.system
    if check.is_step_from_the_start:
        spread = float(np.ptp(values))
        noise = f" but for {check.shown(spread, name, 2)}" if spread else ""
        check.report.warn(
            f"{name} is constant{noise}, so the step is taken to happen at the first sample"
        )
        return
    before = value_before(check.row, system) if check.in_time else None
    if before is None or is_near(float(values[0]), before, values):
        return
    settled = "; if all had settled under it, state `prehistory: equilibrium` in experiments.csv"
    check.report.warn(
        f"{name} begins with {check.shown(values[0], name)} and is assumed to jump there "
        f"from {before:g} at the first sample; if it was on before the record, add the rows since "
        "then"
        f"{settled if knows_prehistory(system, name) else ''}"
    )


def _single_samples(check: Check) -> None:
    """Warn of single outlying samples of a step response, and of any excitation."""
    row, raw = check.row, check.raw
    outliers = {row.excitation: glitches(check.excitation, check.response)}
    if row.protocol in STEPS:
        size = excitation_range(row.protocol, check.excitation, raw.units[row.excitation])
        outliers = {row.response: standing_out(check.excitation, size, check.response), **outliers}
    remedies = {
        row.response: "if the sensor failed there, hide it with `mask_between`",
        row.excitation: "if it was not driven so, correct the row in the file, or remove it",
    }
    for name, samples in outliers.items():
        if samples.size:
            at, values = int(samples[0]), raw.columns[name]
            value, next_value = (check.shown(values[i], name, 6) for i in (at, at + 1))
            check.report.warn(
                f"the single sample at {check.time[at]:.6g} s, {value} before {next_value}, "
                f"stands out{_more(samples)}; {remedies[name]}",
                f"column {name}",
            )


def _more(samples: NDArray[np.intp]) -> str:
    return f" (and {samples.size - 1} more)" if samples.size > 1 else ""


def _jumps(check: Check) -> None:
    """Warn of jumps of the response alone or, in a step or creep, of the excitation alone."""
    row, excitation, response = check.row, check.excitation, check.response
    size = excitation_range(row.protocol, excitation, check.raw.units[row.excitation])
    jumps = {row.response: response_jumps(excitation, size, response)}
    if row.protocol in STEPS:
        jumps[row.excitation] = dropouts(excitation, response)
    remedies = {
        row.response: f"though the {row.excitation} does not; if the specimen or its sensor "
        "slipped or broke there, keep what is before it (`crop`)",
        row.excitation: f"soon jumps back, and the {row.response} does not follow; if it was not "
        "driven so, correct these rows in the file",
    }
    for name, samples in jumps.items():
        if samples.size:
            at, values = int(samples[0]), check.raw.columns[name]
            height = check.shown(values[at] - values[at - 1], name)
            check.report.warn(
                f"jumps by {height} at {check.time[at]:.6g} s{_more(samples)}, {remedies[name]}",
                f"column {name}",
            )
