"""Run the checks of a record that fit its protocol and instruments."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Specimen
from deabayes.integrate.periodic import alike, passes
from deabayes.quantities import with_unit
from deabayes.records import checks
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.records.excitation import (
    STEPS,
    contradictions,
    excitation_range,
    is_near,
    is_step_from_the_start,
    knows_prehistory,
    value_before,
)
from deabayes.records.glitches import (
    dropouts,
    glitches,
    jump_named,
    outliers_named,
    response_jumps,
    standing_out,
)
from deabayes.records.table import WITHOUT_TIME, channels_of
from deabayes.systems.specimen_quantities import instrument

POSITIVE = ("stretch", "area", "frequency", "gain")
FEWEST_SWINGS, PULSES = 4, 0.7
"""Fewest evenly spaced swings that are no step. Second, the share of a record near the ends of
its range above which it is pulses; for a sine the share is 0.41."""
HELD = 0.02
"""Largest change of the excitation in a hold, as a share of its distance from rest."""
BEYOND_SENSOR = 0.05
"""Share by which a clipped sensor may exceed its stated range; more suggests another unit."""


def needed_columns(row: ExperimentRow) -> tuple[str, ...]:
    """Columns that the experiment cannot do without."""
    time = () if row.protocol in WITHOUT_TIME else ("time",)
    return tuple(dict.fromkeys((*time, row.excitation, row.response)))


def record_faults(row: ExperimentRow, raw: RawRecord, specimen: Specimen, where: str) -> list[str]:
    """Every fault of one record; checks that earlier faults make meaningless are left out."""
    needed = needed_columns(row)
    faults = checks.missing_columns(raw.columns, needed, where)
    if faults:
        return faults
    rows = raw.columns[row.response].size
    faults = checks.too_short(rows, where)
    if _is_pull_on_an_actuator(row, specimen):
        faults += checks.unknown_voltage(raw.columns, row.metadata, where)
    faults += _pull_voltage_faults(row, raw, where)
    for name in needed:
        faults += checks.not_finite(raw.columns[name], name, where)
    if faults or rows < checks.SMALLEST_RECORD:
        return faults
    if "time" in needed:
        faults += checks.time_goes_back(raw.columns["time"], where)
        faults += checks.time_repeats(raw.columns["time"], where)
    held = _hold_without_its_ramp(row, raw, where)
    faults += held
    for name in (row.excitation, row.response):
        if not held and not _is_step_from_the_start(row, raw, name):
            faults += checks.constant_channel(raw.columns[name], name, where)
        if name in POSITIVE:
            faults += checks.not_positive(raw.columns[name], name, where)
    faults += _stated_voltage_faults(row, raw, specimen, where)
    faults += _range_faults(row, raw, specimen, where)
    sensor = instrument(specimen, "range", row.response, raw.units[row.response])
    limit = None if sensor is None else sensor.value
    values, unit = raw.columns[row.response], raw.units[row.response]
    faults += checks.mostly_clipped(values, limit, row.response, unit, where)
    faults += _sine_called_a_step(row, raw, where)
    if not faults:
        faults += contradictions(row, raw, specimen, where)
    noise = instrument(specimen, "noise", row.response, raw.units[row.response])
    if noise is not None:
        values = raw.columns[row.response]
        faults += checks.less_than_noise(values, noise.value, row.response, noise.unit, where)
    return faults


def record_warnings(
    row: ExperimentRow, raw: RawRecord, specimen: Specimen, where: str
) -> list[str]:
    """Warnings that a user must know before trusting a record without faults."""
    response, unit = raw.columns[row.response], raw.units[row.response]
    limits = {
        name: None if found is None else found.value
        for name in ("range", "resolution", "noise")
        for found in [instrument(specimen, name, row.response, unit)]
    }
    found = checks.clipped_sensor(response, limits["range"], row.response, unit, where)
    found += checks.coarse_quantisation(
        response, limits["resolution"], limits["noise"], row.response, unit, where
    )
    if raw.left_out:
        rows = raw.left_out + response.size
        found.append(f"{where}: {raw.left_out} of {rows} data rows are left out, without a value "
                     "or at a repeated time (record_format.incomplete_rows)")  # fmt: skip
    if "time" in needed_columns(row):
        found += checks.sampling_jitter(raw.columns["time"], where)
        found += _single_sample_warnings(row, raw, where)
        found += _jump_warnings(row, raw, where)
    found += _beginning_warnings(row, raw, specimen.system, where)
    if row.excitation in COMMANDS:
        found.append(
            f"{where}: {row.excitation} is what was asked of the amplifier and is taken for its "
            "output; where it could not follow, begin the preparation with limit_current"
        )
    limit = instrument(specimen, "current_limit", "current", "A")
    if limit is not None and "current" in raw.columns:
        found += checks.current_at_limit(raw.columns["current"], limit.value, row.protocol, where)
    return found


def _beginning_warnings(row: ExperimentRow, raw: RawRecord, system: str, where: str) -> list[str]:
    """Warn if a jump is assumed at the first sample because the record does not show it."""
    name, values, unit = row.excitation, raw.columns[row.excitation], raw.units[row.excitation]
    if _is_step_from_the_start(row, raw, name):
        spread = float(np.ptp(values))
        noise = f" but for {with_unit(spread, unit, name, digits=2)}" if spread else ""
        return [f"{where}: {name} is constant{noise}, so the step is taken to happen at the first "
                "sample"]  # fmt: skip
    before = value_before(row, system) if "time" in needed_columns(row) else None
    if before is None or is_near(float(values[0]), before, values):
        return []
    settled = "; if all had settled under it, state `prehistory: equilibrium` in experiments.csv"
    return [
        f"{where}: {name} begins with {with_unit(float(values[0]), unit, name, digits=3)} and is "
        f"taken to have been {before:g} until then, to jump at the first sample; if it was on "
        f"before, add the rows since then{settled if knows_prehistory(system, name) else ''}"
    ]


def _single_sample_warnings(row: ExperimentRow, raw: RawRecord, where: str) -> list[str]:
    """Single outlying samples of a step response, and of any excitation."""
    excitation, response = raw.columns[row.excitation], raw.columns[row.response]
    units, time = raw.units, raw.columns["time"]
    found = []
    if row.protocol in STEPS:
        size = excitation_range(row.protocol, excitation, units[row.excitation])
        remedy = "if the sensor failed there, hide it with `mask_between`"
        found.append((standing_out(excitation, size, response), row.response, remedy))
    remedy = "if it was not driven so, correct the row in the file, or remove it"
    found.append((glitches(excitation, response), row.excitation, remedy))
    return [
        f"{where}, {outliers_named(at, time, raw.columns[name], name, units[name], remedy)}"
        for at, name, remedy in found
        if at.size
    ]


def _jump_warnings(row: ExperimentRow, raw: RawRecord, where: str) -> list[str]:
    """Jumps of the response alone or, in a step or creep, of the excitation alone."""
    time, (driven, moved) = raw.columns["time"], (row.excitation, row.response)
    excitation, response = raw.columns[driven], raw.columns[moved]
    size = excitation_range(row.protocol, excitation, raw.units[driven])
    found = [
        (
            response_jumps(excitation, size, response), moved, response,
            f"though the {driven} does not; if the specimen or its sensor slipped or broke there, "
            "keep what is before it (`crop`)",
        )
    ]  # fmt: skip
    if row.protocol in STEPS:
        found.append(
            (
                dropouts(excitation, response), driven, excitation,
                f"soon jumps back, and the {moved} does not follow; if it was not driven so, "
                "correct these rows in the file",
            )
        )  # fmt: skip
    return [
        f"{where}, "
        + jump_named(
            at, time, name, float(values[at[0]] - values[at[0] - 1]), raw.units[name], remedy
        )
        for at, name, values, remedy in found
        if at.size
    ]


def _sine_called_a_step(row: ExperimentRow, raw: RawRecord, where: str) -> list[str]:
    """A creep or step whose excitation swings like a sine; pulses stay at their extremes."""
    if row.protocol not in STEPS or row.excitation not in raw.columns:
        return []
    driven = raw.columns[row.excitation]
    times = passes(raw.columns["time"], driven)
    place = (driven - driven.min()) / (float(np.ptp(driven)) or 1.0)
    at_ends = float(np.mean(np.abs(place - 0.5) > 0.4))
    if times.size < FEWEST_SWINGS or not alike(times).all() or at_ends > PULSES:
        return []
    return [
        f"{where}: is called a {row.protocol}, and its {row.excitation} swings {times.size} times "
        "at even distances; if it is a sine, set its protocol to sine"
    ]


def _hold_without_its_ramp(row: ExperimentRow, raw: RawRecord, where: str) -> list[str]:
    """A relaxation that begins after its ramp: the model would take the strip for relaxed."""
    if row.protocol != "relaxation" or row.excitation not in ("stretch", "displacement"):
        return []
    values = raw.columns[row.excitation]
    departure = np.abs(values - (1.0 if row.excitation == "stretch" else 0.0))
    if float(np.ptp(values)) > HELD * float(departure.max()):
        return []
    return [
        f"{where}, column {row.excitation}: is constant or hardly changes; a relaxation needs the "
        "ramp that led to it, on which the stress depends: add its rows"
    ]


def _is_pull_on_an_actuator(row: ExperimentRow, specimen: Specimen) -> bool:
    """Whether a voltage-driven system is pulled quasi-statically, not driven by voltage."""
    if row.protocol != "quasi_static" or row.excitation == "voltage" or not specimen.system:
        return False
    return "voltage" in channels_of(specimen.system, row.protocol)[0]


def _is_under_held_voltage(row: ExperimentRow) -> bool:
    """Whether a quasi-static record is excited by something other than a voltage."""
    return row.protocol == "quasi_static" and row.excitation != "voltage"


def _pull_voltage_faults(row: ExperimentRow, raw: RawRecord, where: str) -> list[str]:
    """Faults of the constant voltage that a quasi-static record states."""
    if not _is_under_held_voltage(row):
        return []
    if "voltage" in raw.columns:
        return checks.voltage_not_held(raw.columns["voltage"], where)
    if "voltage_kV" in row.metadata:
        return checks.voltage_no_number(row.metadata["voltage_kV"], where)
    return []


def _stated_voltage_faults(
    row: ExperimentRow, raw: RawRecord, specimen: Specimen, where: str
) -> list[str]:
    """Voltages of experiments.csv that contradict the record or, without it, the amplifier."""
    if "voltage" not in raw.columns or row.protocol == "frequency_response":
        limit = instrument(specimen, "range", "voltage", "V")
        given = row.metadata
        return checks.stated_beyond_range(given, limit.value, where) if limit else []
    voltage, stated = raw.columns["voltage"], row.metadata.get
    largest, half = float(np.max(np.abs(voltage))), float(np.ptp(voltage)) / 2.0
    if largest == 0.0 and row.excitation == "voltage":
        return []  # `constant_channel` reports it
    check = checks.voltage_in_another_unit
    found = check(largest, "voltage_kV", stated("voltage_kV"), where)
    if found or _is_step_from_the_start(row, raw, "voltage"):
        return found
    return check(half, "amplitude_kV", stated("amplitude_kV"), where)


def _range_faults(row: ExperimentRow, raw: RawRecord, specimen: Specimen, where: str) -> list[str]:
    """Channels that exceed their instrument's range by more than is possible."""
    allowed = {row.excitation: 1e-9, row.response: BEYOND_SENSOR}
    if _is_under_held_voltage(row) and "voltage" in raw.columns:
        allowed["voltage"] = BEYOND_SENSOR
    faults = []
    for name, share in allowed.items():
        limit = instrument(specimen, "range", name, raw.units[name])
        if limit is not None:
            values = raw.columns[name]
            faults += checks.outside_range(values, limit.value, name, limit.unit, where, share)
    return faults


def _is_step_from_the_start(row: ExperimentRow, raw: RawRecord, channel: str) -> bool:
    """Whether the channel is an excitation that is on and constant from the first sample."""
    values, unit = raw.columns[channel], raw.units[channel]
    return channel == row.excitation and is_step_from_the_start(row.protocol, values, unit)
