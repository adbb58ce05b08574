"""Read and check a record that drives a simulation or a prediction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import Report, UserError, nearest
from deabayes.records.checks import not_finite, time_goes_back, time_repeats
from deabayes.records.columns import CHANNELS, RawRecord
from deabayes.records.record import read_record
from deabayes.systems import system_class
from deabayes.systems.base import System


def read_drive(system: str, path: Path) -> dict[str, FloatArray]:
    """Read the time and the excitation of a record, in SI units.

    Raises
    ------
    UserError, Faults
        No column that drives the system; a time that is missing, has another name, or is not
        needed; values that are not finite, or a coordinate that does not ascend.
    """
    kind = system_class(system)
    record = read_record(path, channels={**CHANNELS, **kind.excitations})
    wanted = ("time", *kind.excitations)
    drive = {name: values for name, values in record.columns.items() if name in wanted}
    channels = [name for name in drive if name != "time"]
    if not channels:
        raise UserError(
            f"{path}: system {system!r} is driven by {' or '.join(kind.excitations)}, and the "
            f"file has only {', '.join(record.columns)}; add such a column"
        )
    _check_time(record, channels, kind, path)
    report = Report(str(path))
    for name, values in drive.items():
        not_finite(report, values, name, otherwise="")
    report.raise_faults()
    if "time" in drive:
        time_goes_back(report, drive["time"])
        time_repeats(report, drive["time"], otherwise="")
    else:
        _check_ascending(report, drive, kind)
    report.raise_faults()
    return drive


def _check_time(record: RawRecord, channels: list[str], kind: type[System], path: Path) -> None:
    """Refuse a time that the system does not use, that has another name, or that is missing."""
    first = channels[0]
    if "time" in record.columns:
        if all(name in kind.without_time for name in channels):
            raise UserError(
                f"{path}: {first} moves system {kind.name!r} through steady states, without time; "
                f"remove the column 'time', and sort the rows so that {first} ascends"
            )
        return
    other_names = [name for name, unit in record.units.items() if unit == "s"]
    if other_names:
        raise UserError(
            f"{path}: column {other_names[0]!r} is a time with another name; call it 'time [s]' "
            "with the unit it has, or remove it if the excitation is quasi-static"
        )
    in_time = [name for name in channels if name in kind.in_time]
    if in_time:
        raise UserError(
            f"{path}: column 'time' is missing, and {in_time[0]} drives the system in time"
            f"{nearest('time', record.columns)}; write its header as 'time [s]'"
        )


def _check_ascending(report: Report, drive: dict[str, FloatArray], kind: type[System]) -> None:
    """Report channels that do not ascend, as a coordinate without time must."""
    for name, values in drive.items():
        back = np.flatnonzero(np.diff(values) <= 0.0)
        if back.size:
            remedy = "" if name in kind.without_time else ", or add a column 'time [s]'"
            report.fault(
                f"does not ascend at data row {back[0] + 2}, and there is no time; sort the rows"
                f"{remedy}",
                f"column {name}",
            )
