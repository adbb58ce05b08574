"""The drive that `deabayes simulate` follows: columns of a record, checked row by row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.faults import Faults, UserError, nearest

if TYPE_CHECKING:
    from deabayes.experiment import FloatArray
    from deabayes.reading.raw import RawRecord


def read_drive(system: str, path: Path) -> dict[str, FloatArray]:
    """The time and the channels of a record that drive a system; SI.

    Raises
    ------
    UserError, Faults
        No column that drives the system, none called `time` where one is needed or some other
        is a time, values that cannot be followed.
    """
    from deabayes.reading.columns import CHANNELS
    from deabayes.reading.records import read_record
    from deabayes.systems import system_class

    kind = system_class(system)
    record = read_record(path, channels={**CHANNELS, **kind.excitations})
    wanted = ("time", *kind.excitations)
    driven = {name: values for name, values in record.columns.items() if name in wanted}
    drives = [name for name in driven if name != "time"]
    if not drives:
        raise UserError(
            f"{path}: has no column {' or '.join(kind.excitations)} to drive system {system!r}, "
            f"only {', '.join(record.columns)}"
        )
    steady = [name for name in drives if name in kind.without_time]
    if "time" in driven and steady == drives:
        raise UserError(
            f"{path}: {steady[0]} drives system {system!r} from one steady state to the next, at "
            "no time; remove the column 'time', and sort the rows so that the rest ascends"
        )
    if "time" not in driven:
        _check_without_time(record, [name for name in drives if name in kind.in_time], path)
    faults = _faults(driven, str(path), steady)
    if faults:
        raise Faults(faults)
    return driven


def _check_without_time(record: RawRecord, in_time: list[str], path: Path) -> None:
    """Refuse a record that has a time by another name, or that says nothing without one."""
    times = [name for name, unit in record.units.items() if unit == "s"]
    if times:
        raise UserError(
            f"{path}: column {times[0]!r} is a time but is not called so; write 'time [s]' with "
            "the unit it has, or remove the column where the drive is quasi-static"
        )
    if in_time:
        raise UserError(
            f"{path}: column 'time' is missing, {in_time[0]} drives the system in time"
            f"{nearest('time', record.columns)}; write its header as 'time [s]'"
        )


def _faults(driven: Mapping[str, FloatArray], where: str, steady: list[str]) -> list[str]:
    from deabayes.reading.checks import not_finite, time_goes_back, time_repeats

    faults = [f for name, values in driven.items() for f in not_finite(values, name, where, "")]
    if faults:
        return faults
    if "time" in driven:
        return time_goes_back(driven["time"], where) + time_repeats(driven["time"], where, "")
    for name, values in driven.items():
        back = np.flatnonzero(np.diff(values) <= 0.0)
        if back.size:
            faults.append(
                f"{where}, column {name}: does not ascend at data row {back[0] + 2}, as a drive "
                "without time must; sort the rows"
                + ("" if name in steady else ", or give the time as a column 'time [s]'")
            )
    return faults
