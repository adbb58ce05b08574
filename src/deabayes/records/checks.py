"""Checks of one record: faults that a user must correct."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray, Quantity, Specimen
from deabayes.faults import Report, rename_hint
from deabayes.integrate.periodic import alike, passes, usual_period
from deabayes.quantities import with_unit
from deabayes.records.cautions import warn_of_record
from deabayes.records.channels import STEPS, Check, is_held, share_at, usual_interval
from deabayes.records.columns import CHANNELS, ExperimentRow, RawRecord
from deabayes.records.record import REMEDY
from deabayes.records.table import WITHOUT_TIME, channels_of, measured_rows
from deabayes.systems.specimen_quantities import instrument

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
        warn_of_record(check)
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
    at_limit = 0.0 if limit is None else share_at(check.response, limit.value)
    if limit is not None and at_limit > MOSTLY:
        check.report.fault(
            f"{at_limit:.0%} of the values lie at the sensor's range of "
            f"{check.shown(limit.value, row.response, 6)}; record it with a wider range, or cut "
            "the record there",
            f"column {row.response}",
        )


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
