"""From a raw record to a working record: which column is what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray, Specimen
from deabayes.faults import Faults
from deabayes.preparation.working import WorkingRecord
from deabayes.reading.columns import COMMANDS
from deabayes.reading.raw import ExperimentRow, RawRecord
from deabayes.reading.record_checks import record_faults, record_warnings

EXCITATION_COLUMN = "excitation_column"
NOT_CONDITIONS = ("note", EXCITATION_COLUMN)


def coordinate_name(row: ExperimentRow) -> str:
    """Time, except where a record has none: then the excitation itself."""
    return row.excitation if row.protocol in ("quasi_static", "frequency_response") else "time"


def open_record(row: ExperimentRow, raw: RawRecord, specimen: Specimen) -> WorkingRecord:
    """The channels that the row names, checked; nothing else is changed.

    A command (`control_voltage`) is taken for the excitation that it asks for.

    A record without time is put in ascending order of its coordinate, and a phase, which is
    known but for whole turns, is made continuous (see `continuous_phase`).

    Raises
    ------
    Faults : what `reading.record_checks` finds wrong.
    """
    where = f"{row.record} ({row.name})"
    faults = record_faults(row, raw, specimen, where)
    if faults:
        raise Faults(faults)
    name = coordinate_name(row)
    coordinate = np.asarray(raw.columns[name], dtype=float)
    record = WorkingRecord(
        row=_as_excitation(row),
        specimen=specimen,
        coordinate_name=name,
        coordinate_unit=raw.units[name],
        response_unit=raw.units[row.response],
        excitation_unit=raw.units[row.excitation],
        coordinate=coordinate,
        response=np.asarray(raw.columns[row.response], dtype=float),
        used=np.ones(coordinate.size, dtype=bool),
        samples_averaged=np.ones(coordinate.size),
        excitation_coordinate=coordinate,
        excitation=np.asarray(raw.columns[row.excitation], dtype=float),
        warnings=tuple(record_warnings(row, raw, specimen, where)),
    )
    if record.in_time:
        return record
    record = _ascending(record)
    if row.response != "phase":
        return record
    return replace(record, response=continuous_phase(record.response))


def _as_excitation(row: ExperimentRow) -> ExperimentRow:
    """The row with what its command asks for in the command's place, and a note of the column."""
    if row.excitation not in COMMANDS:
        return row
    metadata = {**row.metadata, EXCITATION_COLUMN: row.excitation}
    return replace(row, excitation=COMMANDS[row.excitation], metadata=metadata)


def continuous_phase(phase: FloatArray) -> FloatArray:
    """The phase [rad] without jumps of a turn, its first value above -3/4 turn, up to +1/4.

    An actuator lags; a quarter of a turn is left for what noise and rounding make of zero.
    """
    unwrapped = np.unwrap(phase)
    turn = 2.0 * np.pi
    return np.asarray(unwrapped - turn * np.ceil((unwrapped[0] - 0.25 * turn) / turn))


def _ascending(record: WorkingRecord) -> WorkingRecord:
    """A record without time, sorted by its coordinate."""
    steps = np.diff(record.coordinate)
    if np.all(steps >= 0.0):
        return record
    order = np.argsort(record.coordinate, kind="stable")
    ordered = replace(
        record,
        coordinate=record.coordinate[order],
        response=record.response[order],
        excitation_coordinate=record.coordinate[order],
        excitation=record.excitation[order],
    )
    if np.all(steps <= 0.0):
        return ordered
    loaded = record.row.protocol == "quasi_static"
    mixed = ", so that loading and unloading are mixed" if loaded else ""
    return ordered.with_warning(
        f"{record.coordinate_name} goes back and forth; samples were put in ascending order{mixed}"
    )


def conditions(row: ExperimentRow, raw: RawRecord) -> dict[str, float | str]:
    """What was held during the record: the row's metadata, and the voltage of a pull test [V].

    The column `voltage` has the say where there is one, `voltage_kV` otherwise; that it is held
    is checked in `reading.record_checks`.
    """
    held = {key: value for key, value in row.metadata.items() if key not in NOT_CONDITIONS}
    if row.protocol != "quasi_static" or row.excitation == "voltage":
        return held
    if "voltage" in raw.columns:
        held["voltage"] = float(np.mean(raw.columns["voltage"]))
    elif "voltage_kV" in held:
        held["voltage"] = 1000.0 * float(held["voltage_kV"])
    return held
