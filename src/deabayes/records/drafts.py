"""Draft experiments.csv and record_format from the files of instruments, with guesses marked."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deabayes.experiment import FREQUENCY_RESPONSE, FloatArray
from deabayes.faults import UserError
from deabayes.integrate.periodic import alike, passes
from deabayes.records.columns import COMMANDS, UNKNOWN_UNIT, Column, Table, with_channel_names
from deabayes.records.conversion import numbers
from deabayes.records.guesses import likely_columns, text_of
from deabayes.records.marks import MARK, marked
from deabayes.records.record import read_table_of
from deabayes.systems import REGISTRY, system_class
from deabayes.systems.base import System

FORMATS: Sequence[Mapping[str, str]] = (
    {},
    {"encoding": "cp1252"},
    {"decimal": ","},
    {"encoding": "cp1252", "decimal": ","},
)
"""Settings under which the files are tried, until all can be read."""
NAMED_BY_VARIABLE = (".mat", ".tdms")
"""Files of which only the columns are read that experiments.csv names."""
FEWEST_PASSES = 3
NEAR, HELD, BACK = 0.02, 0.3, 0.5
"""Shares of the largest departure: equal values, the least share of samples in a hold, and a
last value so low that the record has been unloaded."""


@dataclass(frozen=True)
class Draft:
    """What `deabayes new` writes for given files.

    Attributes
    ----------
    system : its name, with a mark if it is a guess.
    table : content of experiments.csv.
    record_format : settings that the files need, with marks.
    files : name in `records/` -> the file to be copied there.
    """

    system: str
    table: str
    record_format: Mapping[str, str]
    files: Mapping[str, Path]


@dataclass(frozen=True)
class Reading:
    """How one system would use the columns of one file."""

    protocols: Sequence[str]
    excitation: str
    response: str
    columns: Mapping[str, Column]


def draft(paths: Sequence[Path], system: str | None = None) -> Draft:
    """Draft a study of some files.

    Parameters
    ----------
    system : its name; None guesses it if only one system has such columns.

    Raises
    ------
    UserError : a file that cannot be read or has no column for the system; several systems fit.
    """
    tables, settings = _read_all(paths)
    guess = _only_system(tables) if system is None else system
    kind = system_class(guess)
    names = _names(paths)
    rows = []
    for path, table in tables.items():
        reading = _reading(table, kind)
        if reading is None:
            have = ", ".join(repr(column.name) for column in table.columns if column.name)
            raise UserError(
                f"{path}: no column can be what drives a {guess} ({_listed(kind.excitations)}) or "
                f"how it responds ({_listed(kind.responses)}); the file has {have}. Name another "
                "system, or make the folder without this file"
            )
        rows.append(_row(names[path], path, table, reading, kind))
    _give_roles(rows)
    return Draft(
        guess if system else marked(guess),
        _written(rows),
        {key: marked(value) for key, value in settings.items()},
        {f"{names[path]}{path.suffix.lower()}": path for path in paths},
    )


def _listed(channels: Iterable[str]) -> str:
    return ", ".join(channels)


def _read_all(paths: Sequence[Path]) -> tuple[dict[Path, Table], Mapping[str, str]]:
    """Read all files under the same settings, since a study has one record_format."""
    for path in paths:
        if path.is_dir():
            raise UserError(f"{path}: is a folder; name files behind --from")
        if not path.is_file():
            raise UserError(f"{path}: there is no such file; name files behind --from")
    first: UserError | None = None
    for settings in FORMATS:
        try:
            tables = {path: _with_values(read_table_of(path, settings)) for path in paths}
        except UserError as error:
            first = first or error
        else:
            return tables, settings
    assert first is not None
    raise first


def _with_values(table: Table) -> Table:
    """Return the table without columns that hold no value at all."""
    pairs = zip(table.columns, table.arrays, strict=True)
    kept = [(column, array) for column, array in pairs if not np.all(array != array)]
    return replace(table, columns=[c for c, _ in kept], arrays=[array for _, array in kept])


def _only_system(tables: Mapping[Path, Table]) -> str:
    """Return the only system that can use all files.

    Raises
    ------
    UserError : none or several can.
    """
    fits = [
        name
        for name in REGISTRY
        if all(_reading(table, system_class(name)) for table in tables.values())
    ]
    if len(fits) == 1:
        return fits[0]
    first, *others = tables
    more = f" and {len(others)} more" if others else ""
    found = f"the columns suit {', '.join(fits)}" if fits else "no system has all their columns"
    raise UserError(
        f"{first}{more}: {found}; say what was tested by --system {' | '.join(fits or REGISTRY)}"
    )


def _reading(table: Table, kind: type[System]) -> Reading | None:
    """Return how a system would use a file, None if it lacks an excitation or a response."""
    commands = {name: kind.excitations[of] for name, of in COMMANDS.items() if of in kind.in_time}
    known = {"time": "s", **kind.excitations, **kind.responses, **commands}
    channels = {**known, "phase": "rad"} if "gain" in known else known
    likely = likely_columns(with_channel_names(table.columns, channels), channels)
    driving = [name for name in (*kind.excitations, *commands) if name in likely]
    if "frequency" in likely and "gain" in likely:
        return Reading(("frequency_response",), "frequency", "gain", likely)
    driving = [name for name in driving if name not in FREQUENCY_RESPONSE]
    protocols: Sequence[str]
    if "time" in likely:
        protocols = [p for p in kind.protocols if p not in ("quasi_static", "frequency_response")]
        driving = [name for name in driving if name not in kind.without_time]
        protocols = list(kind.protocols) if not kind.in_time else protocols
    else:
        protocols = [protocol for protocol in kind.protocols if protocol == "quasi_static"]
        driving = [name for name in driving if name in kind.without_time or not kind.in_time]
    excitation = next(iter(driving), None)
    responses = [
        r for r in kind.responses if r in likely and r not in (excitation, "gain", "phase")
    ]
    if not protocols or excitation is None or not responses:
        return None
    responses.sort(key=lambda name: likely[name].unit == UNKNOWN_UNIT)
    return Reading(protocols, excitation, responses[0], likely)


def _row(
    name: str, path: Path, table: Table, reading: Reading, kind: type[System]
) -> dict[str, str]:
    """Return a row of experiments.csv, but for its role."""
    protocol = _protocol(table, reading)
    row = {
        "name": name,
        "protocol": protocol if len(reading.protocols) == 1 else marked(protocol),
        "record": f"records/{name}{path.suffix.lower()}",
        "role": "",
        "excitation": _chosen(reading.excitation, kind.excitations, reading),
        "response": _chosen(reading.response, kind.responses, reading),
        "columns": _columns_cell(path, table, reading),
    }
    conditions = (kind.conditions or {}).get(reading.excitation, {})
    if "voltage" in conditions and "voltage" not in reading.columns:
        row["voltage_kV"] = MARK
    if protocol == "frequency_response":
        row["bias_kV"] = MARK
    return row


def _chosen(channel: str, channels: Mapping[str, str], reading: Reading) -> str:
    """Return the channel, as a guess if the file has another of its kind."""
    others = [c for c in channels if c in reading.columns and c != channel]
    others = [c for c in others if c not in (reading.excitation, reading.response, "phase")]
    return marked(channel) if others else channel


def _columns_cell(path: Path, table: Table, reading: Reading) -> str:
    """Return the names of the columns that their file does not give them, as guesses."""
    used = {"time", "voltage", "phase", reading.excitation, reading.response}
    wanted = {name: column for name, column in reading.columns.items() if name in used}
    given = {c.name for c in with_channel_names(table.columns, wanted) if c.unit is not None}
    guessed = [column for name, column in wanted.items() if name not in given]
    if not guessed:
        return ""
    listed = wanted.values() if path.suffix.lower() in NAMED_BY_VARIABLE else guessed
    return "; ".join(
        marked(text_of([column])) if column in guessed else text_of([column]) for column in listed
    )


def _protocol(table: Table, reading: Reading) -> str:
    """Guess the protocol from how the excitation moves; a mark alone if its values are unusable."""
    if len(reading.protocols) == 1:
        return reading.protocols[0]
    try:
        time, driven = (_values(table, reading.columns[c]) for c in ("time", reading.excitation))
    except UserError:
        return MARK
    sound = np.isfinite(time) & np.isfinite(driven)
    time, driven = time[sound], driven[sound]
    if driven.size < FEWEST_PASSES:
        return MARK
    likely = [protocol for protocol in _shapes(time, driven) if protocol in reading.protocols]
    return next(iter(likely), MARK)


def _values(table: Table, column: Column) -> FloatArray:
    """Return the samples of a column in its own unit."""
    sources = [other.source or other.name for other in table.columns]
    return numbers(table.arrays[sources.index(column.source)], str(column.source), table.decimal)


def _shapes(time: FloatArray, driven: FloatArray) -> list[str]:
    """Return protocols of such an excitation, the likeliest first."""
    times = passes(time, driven)
    gone = np.abs(driven - driven[0])
    largest = float(gone.max()) or 1.0
    levels = np.mean(np.abs(gone - gone[-1]) <= NEAR * largest)
    if times.size >= FEWEST_PASSES:
        return ["sine" if alike(times).all() else "sweep", "load_unload"]
    if gone[-1] < BACK * largest and float(gone.max()) > 0.0:
        return ["load_unload", "step", "creep"]
    if levels >= HELD:
        return ["relaxation", "creep", "step"]
    return ["quasi_static", "step", "creep"]


def _names(paths: Sequence[Path]) -> dict[Path, str]:
    """Return a name for each file's experiment: its own, without signs that no name has."""
    names: dict[Path, str] = {}
    for path in paths:
        plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem).strip("_.-") or "record"
        taken = {name.lower() for name in names.values()}
        numbered = (plain, *(f"{plain}_{number}" for number in range(2, len(paths) + 2)))
        names[path] = next(name for name in numbered if name.lower() not in taken)
    return names


def _give_roles(rows: Sequence[dict[str, Any]]) -> None:
    """Hold the last of several records out."""
    for row in rows:
        row["role"] = marked("calibrate")
    if len(rows) > 1:
        rows[-1]["role"] = marked("validate")


def _written(rows: Sequence[Mapping[str, str]]) -> str:
    """Return experiments.csv with one row per file."""
    header = list(dict.fromkeys(name for row in rows for name in row))
    stream = io.StringIO()
    stream.write(
        "# A ? stands behind each guess. Correct what is wrong and remove the ?; fill in a ? that "
        "stands alone.\n"
    )
    writer = csv.DictWriter(stream, [*header, "note"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()
