"""Columns of a record: names, units and conversion to SI."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Role
from deabayes.faults import Report, UserError
from deabayes.units import same_dimension, si_unit, to_si


@dataclass(frozen=True)
class ExperimentRow:
    """One row of experiments.csv; additional columns are in `metadata`."""

    name: str
    protocol: str
    record: str
    role: Role
    excitation: str
    response: str
    metadata: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class RawRecord:
    """One record as in its file, with columns converted to SI and no other change.

    Attributes
    ----------
    columns, units : channel name -> its samples, and its SI unit.
    left_out : number of rows removed because specimen.yaml says so (`incomplete_rows`).
    warnings : name of each experiment of the record -> what its checks warn of.
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]
    sha256: str
    left_out: int = 0
    warnings: Mapping[str, Sequence[str]] = field(default_factory=dict)


CHANNELS: Mapping[str, str] = {
    "time": "s",
    "voltage": "V",
    "control_voltage": "V",
    "current": "A",
    "strain": "1",
    "stretch": "1",
    "displacement": "m",
    "area": "m^2",
    "force": "N",
    "nominal_stress": "Pa",
    "frequency": "Hz",
    "gain": "1/V",
    "phase": "rad",
}
"""Record columns with a defined meaning (data.md) -> SI unit."""
COMMANDS: Mapping[str, str] = {"control_voltage": "voltage"}
"""Columns that hold a command to an instrument -> the excitation that it asks for."""

HEADER_CELL = re.compile(r"^\s*(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
UNIT_IN_PARENTHESES = re.compile(r"^(?P<name>.*?)\s*\((?P<unit>[^()]*)\)$")
OTHER_DECIMAL = re.compile(r"[+-]?\d*[.,]\d+([eE][+-]?\d+)?")
"""A text that would be a number with the other decimal sign."""
SWAPPED = str.maketrans(",.", ".,")
CLOCK = re.compile(r"(\d{1,4}([-./])\d{1,2}\2\d{1,4}(?!\d)|\d+:[0-5]\d(?!\d)|\d+ days?\b)")
"""Beginning of a date, a time of day or a time span, as loggers and Excel write them."""
COMMENT = re.compile(r"#(?!(?:N/[AD]|NV|IND|QNAN|SNAN|INF|[A-Z/0]+[!?])(?:[\s,;\"]|$))")
"""A `#` begins a comment, unless it is part of an Excel error (`#N/A`, `#WERT!`) or of
`1.#QNAN`."""


@dataclass(frozen=True)
class Column:
    """A column of a file.

    Attributes
    ----------
    name : channel name; None or ``-`` for a column to be ignored.
    unit : as written; None if not given.
    offset : added after conversion to SI (1 turns a strain into a stretch).
    source : the variable or channel in the file, if it differs from `name`.
    """

    name: str | None
    unit: str | None
    offset: float = 0.0
    source: str | None = None


@dataclass(frozen=True)
class Table:
    """Content of a file before conversion: one array per column.

    `decimal` is the decimal sign of numbers in text columns.
    """

    columns: Sequence[Column]
    arrays: Sequence[NDArray[Any]]
    decimal: str = "."


def from_header(cells: Iterable[object]) -> list[Column]:
    """Make columns from header cells such as ``time [s]``, which may contain line breaks."""
    columns = []
    for cell in cells:
        match = HEADER_CELL.match(" ".join(str(cell if cell is not None else "").split()))
        assert match is not None  # every part of the pattern is optional
        columns.append(Column(match["name"] or None, match["unit"]))
    return columns


def from_format(record_format: Mapping[str, Any] | None) -> list[Column] | None:
    """Return the columns that `record_format` lists, or None if it lists none."""
    settings = (record_format or {}).get("columns")
    if settings is None:
        return None
    return [
        Column(c.get("name"), c.get("unit"), float(c.get("offset", 0.0)), c.get("source"))
        for c in settings
    ]


def renamed(columns: list[Column], named: Sequence[Column] | None, where: str) -> list[Column]:
    """Give columns of a file the names, and any units, that experiments.csv states.

    All columns are looked up by their names in the file, so that two can be swapped.
    """
    columns_renamed = list(columns)
    for given in named or ():
        source = from_header([given.source or given.name])[0].name
        places = [i for i, column in enumerate(columns) if source in (column.name, column.source)]
        if len(places) != 1:
            known = ", ".join(repr(c.name) for c in columns if c.name)
            raise UserError(
                f"{where}: {'two columns are' if places else 'no column is'} called {source!r}, as "
                f"`columns` in experiments.csv says (there are {known}); correct one of them"
            )
        old = columns[places[0]]
        unit = old.unit if given.unit is None else given.unit
        columns_renamed[places[0]] = replace(old, name=given.name, unit=unit, source=source)
    return columns_renamed


def from_text(text: str) -> list[Column]:
    """Make columns from a cell of experiments.csv: ``t = time [s]; voltage [kV]``."""
    columns = []
    for part in filter(None, (part.strip() for part in text.split(";"))):
        source, equals, cell = part.partition("=")
        column = from_header([cell if equals else part])[0]
        columns.append(Column(column.name, column.unit, source=source.strip() if equals else None))
    return columns


def to_record(table: Table, sha256: str, channels: Mapping[str, str], where: str) -> RawRecord:
    """Convert a table to SI.

    A known channel without a unit is a fault. Other columns without a valid unit are left out. A
    column with a unit must hold numbers.

    Raises
    ------
    Faults : every fault of every column.
    """
    errors = Report()
    report = errors.at(where)
    unnamed = set(channels) - {column.name for column in table.columns}
    values: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    for column, array in zip(table.columns, table.arrays, strict=True):
        name = column.name
        if column.unit is None and (wrong := _unit_mistaken(name, unnamed)):
            report.fault(f"the unit of column {name!r} {wrong}")
        elif name in (None, "-") or (name not in channels and not _is_unit(column.unit)):
            continue
        elif name in values:
            report.fault(f"column {name!r} occurs twice; rename or remove one")
        else:
            with errors.catching():
                place = f"{where}, column {name}"
                values[name] = _convert(column, array, channels.get(name), place, table.decimal)
                units[name] = channels.get(name) or si_unit(column.unit or "")
    report.raise_faults()
    return RawRecord(values, units, sha256)


def _is_unit(unit: str | None) -> bool:
    return unit is not None and same_dimension(unit, unit)


def _unit_mistaken(name: str | None, channels: Collection[str]) -> str | None:
    """Say what is wrong with how the unit of one of `channels` is written, None if nothing."""
    before, bracket, after = (name or "").partition("[")
    if bracket and before.strip() in channels:
        unit, end, _ = after.partition("]")
        if not end:
            return f"has no end; write '{name}]'"
        return (
            f"has text behind it; write '{before}[{unit}]', and a factor as another unit, there or "
            "in `columns` of experiments.csv"
        )
    match = UNIT_IN_PARENTHESES.match(name or "")
    if match and match["name"].lower() in channels:
        return f"stands in round brackets; write '{match['name'].lower()} [{match['unit']}]'"
    return None


def _convert(
    column: Column, array: NDArray[Any], expected_unit: str | None, where: str, decimal: str
) -> FloatArray:
    if column.unit is None:
        raise UserError(f"{where}: no unit; write '{column.name} [{expected_unit or '1'}]'")
    return to_si(numbers(array, where, decimal), column.unit, expected_unit, where) + column.offset


def numbers(array: NDArray[Any], where: str, decimal: str = ".") -> FloatArray:
    """Return the array as floats; a text that is no number is reported with its row.

    With a decimal comma, a text with a point (2.500, or 2500?) is no number.
    """
    if array.dtype.kind in "fiub":
        return np.asarray(array, dtype=float).ravel()
    if array.dtype.kind == "c" or (array.dtype.names and "imag" in array.dtype.names):
        raise UserError(f"{where}: holds complex numbers; save its modulus and phase")
    import pandas as pd

    series = pd.Series(array.ravel(), dtype=object)
    try:
        written = series if decimal == "." else series.map(_signs_swapped)
        converted = pd.to_numeric(written, errors="coerce")
    except TypeError:  # pandas raises it for structures in a cell array
        raise UserError(f"{where}: holds structures; save their fields as variables") from None
    bad = np.flatnonzero(converted.isna() & series.notna())
    if bad.size:
        cell, rows = str(series[bad[0]]), f"({bad.size} such rows)"
        raise UserError(f"{where}, data row {bad[0] + 1}: {_no_number(cell, rows)}")
    return np.asarray(converted, dtype=float)


def _signs_swapped(cell: object) -> object:
    return cell.translate(SWAPPED) if isinstance(cell, str) else cell


def _no_number(cell: str, rows: str) -> str:
    """Describe a text that should be a number, and say what to do."""
    if cell.startswith("="):
        return (
            f"{cell!r} is a formula without a stored value {rows}; open the file in a "
            "spreadsheet program and save it"
        )
    if CLOCK.match(cell):
        return f"{cell!r} is a date or a clock time {rows}; give seconds since the first row"
    if OTHER_DECIMAL.fullmatch(cell):
        has, has_not = ("comma", "point") if "," in cell else ("point", "comma")
        return (
            f"{cell!r} has a decimal {has} where the numbers are read with a decimal {has_not} "
            f"{rows}; write the whole file with one of them, and without separators of thousands"
        )
    return f"{cell!r} is not a number {rows}; correct or remove them"


def unit_hint(header: Iterable[str]) -> str:
    """Say how to write the first header cell that has its unit in parentheses."""
    for cell in header:
        match = UNIT_IN_PARENTHESES.match(cell.strip())
        if match:
            return f"; write '{match['name']} [{match['unit']}]' instead of {cell.strip()!r}"
    return ""
