"""Convert the columns of a file to SI units, and say which columns are missing."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import Report, UserError
from deabayes.records.columns import (
    UNKNOWN_UNIT,
    Column,
    RawRecord,
    Table,
    is_unit,
    with_channel_names,
)
from deabayes.records.guesses import has_other_name, likely_columns, source_of, text_of
from deabayes.units import si_unit, to_si

OTHER_DECIMAL = re.compile(r"[+-]?\d*[.,]\d+([eE][+-]?\d+)?")
"""A text that would be a number with the other decimal sign."""
SWAPPED = str.maketrans(",.", ".,")
CLOCK = re.compile(r"(\d{1,4}([-./])\d{1,2}\2\d{1,4}(?!\d)|\d+:[0-5]\d(?!\d)|\d+ days?\b)")
"""Beginning of a date, a time of day or a time span, as loggers and Excel write them."""
ALWAYS_READ = ("voltage", "control_voltage", "phase")
"""Channels that matter to checks and measurements even if no row names them."""


def to_record(
    table: Table,
    sha256: str,
    channels: Mapping[str, str],
    where: str,
    needed: Sequence[str] | None = None,
) -> RawRecord:
    """Convert a table to SI.

    A known channel without a unit is a fault. Other columns without a valid unit are left out. A
    column with a unit must hold numbers.

    Parameters
    ----------
    needed : channels that must be there. Other columns that cannot be read are then left out. None
        requires every known channel to be sound.

    Raises
    ------
    Faults : every fault of every column; a needed channel without a column.
    """
    columns = with_channel_names(table.columns, channels)
    errors = Report()
    _refuse_missing(columns, channels, needed, errors.at(where))
    errors.raise_faults()
    unnamed = set(channels) - {column.name for column in columns}
    values: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    left_out = []
    for column, array in zip(columns, table.arrays, strict=True):
        name, found = column.name, Report()
        if column.unit is None and (wrong := _unit_mistaken(name, unnamed)):
            found.fault(f"{where}: the unit of column {name!r} {wrong}")
        elif name in (None, "-") or (name not in channels and not is_unit(column.unit)):
            left_out.append(column)
        elif name in values:
            alone = [c.source for c in columns].count(column.source) == 1
            remedy = f"leave one out by `columns`: {column.source} = -" if alone else "rename one"
            found.fault(f"{where}: column {name!r} occurs twice; {remedy}")
        else:
            with found.catching():
                place = f"{where}, column {name}"
                values[name] = _convert(column, array, channels.get(name), place, table.decimal)
                units[name] = channels.get(name) or si_unit(column.unit or "")
        if needed is None or _called(column) in needed:
            errors.include(found.faults)
        elif _called(column) in ALWAYS_READ:
            errors.include(f"{f}, or leave it out by `columns`: {name} = -" for f in found.faults)
        elif found.faults:
            left_out.append(column)
    errors.raise_faults()
    notes = (*table.notes, *_notes(columns, left_out, values))
    return RawRecord(values, units, sha256, notes=notes)


def _refuse_missing(
    columns: Sequence[Column],
    channels: Mapping[str, str],
    needed: Sequence[str] | None,
    report: Report,
) -> None:
    """Report needed channels without a column, with the text that names their columns."""
    with_unit = any(column.unit is not None for column in columns)
    there = {_called(column) for column in columns}
    missing = [name for name in needed or () if name not in there]
    if with_unit and not missing:
        return
    wanted = {name: channels.get(name, "1") for name in needed or channels}
    likely = likely_columns(columns, wanted)
    if needed is not None:
        likely = {name: likely.get(name, Column(name, UNKNOWN_UNIT, source="?")) for name in needed}
    have = ", ".join(
        repr(source_of(column)) for column in columns if column.name not in (None, "-")
    )
    subject = f"no column is {' or '.join(missing)}" if missing else "no column has a unit"
    proposal = text_of(likely.values()) or "t = time [s]; U = voltage [kV]"
    hint = ", and replace each ?" if "?" in proposal else ""
    report.fault(
        f"{subject}; the file has {have or 'none with a name'}. Put this into the column `columns` "
        f"of experiments.csv{hint}: {proposal}"
    )


def _called(column: Column) -> str:
    """Return a column's name without a unit whose bracket has no end or text behind it."""
    return (column.name or "").partition("[")[0].strip()


def _notes(
    columns: Sequence[Column], left_out: Sequence[Column], read: Collection[str]
) -> list[str]:
    """Say which columns have another name in the file, and which are left out."""
    other = [c for c in columns if c.name in read and c not in left_out and has_other_name(c)]
    notes = [f"columns {text_of(other)}"] if other else []
    names = ", ".join(n for n in dict.fromkeys(map(source_of, left_out)) if n not in ("", "-"))
    return [*notes, f"left out: {names}"] if names else notes


def _unit_mistaken(name: str | None, channels: Collection[str]) -> str | None:
    """Say what is wrong with how the unit of one of `channels` is written, None if nothing."""
    before, bracket, after = (name or "").partition("[")
    if not bracket or before.strip() not in channels:
        return None
    unit, end, _ = after.partition("]")
    if not end:
        return f"has no end; write '{name}]'"
    return (
        f"has text behind it; write '{before}[{unit}]', and a factor as another unit, there or "
        "in `columns` of experiments.csv"
    )


def _convert(
    column: Column, array: NDArray[Any], expected_unit: str | None, where: str, decimal: str
) -> FloatArray:
    if column.unit == UNKNOWN_UNIT:
        raise UserError(f"{where}: write its unit in place of the question mark, such as "
                        f"'{column.name} [{expected_unit or '1'}]'")  # fmt: skip
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
