"""Read records from Excel files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.faults import UserError
from deabayes.records.columns import (
    COMMENT,
    Column,
    Table,
    from_format,
    from_header,
    renamed,
    unit_hint,
)
from deabayes.records.matlab import opened
from deabayes.records.text import refuse_skipped_data


def read_xlsx(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    named: Sequence[Column] | None = None,
) -> Table:
    """Read the first sheet; its first row, or the first below `header_lines`, is the header.

    Empty rows and comments do not count. `named` holds names and units that experiments.csv
    gives to columns of the header.
    """
    rows = opened(_first_sheet, path, "an Excel file")
    header_lines = int((record_format or {}).get("header_lines", 0))
    skipped, rows = rows[:header_lines], rows[header_lines:]
    columns = from_format(record_format)
    if columns is None:
        columns, rows = _header(rows[0] if rows else (), path, named), rows[1:]
    else:
        refuse_skipped_data(_filled(skipped[-1]) if skipped else [], len(columns), path)
        _refuse_unnamed(path, len(columns), rows)
        columns = renamed(columns, named, str(path))
    if not rows:
        raise UserError(f"{path}: the first sheet holds no data rows; copy the record again")
    width = max(map(len, rows))
    if width < len(columns):
        raise UserError(
            f"{path}: {len(columns)} columns are named, but the first sheet has {width}"
        )
    filled = zip(*(row + (None,) * (width - len(row)) for row in rows), strict=True)
    return Table(columns, [_cells(values) for _, values in zip(columns, filled, strict=False)])


def _first_sheet(path: Path) -> list[tuple[object, ...]]:
    """Return rows with content; a formula without a stored value appears as its own text."""
    rows = _rows(path, calculated=True)
    if any(None in row for row in rows):
        written = _rows(path, calculated=False)
        rows = [
            tuple(other if cell is None else cell for cell, other in zip(*pair, strict=True))
            for pair in zip(rows, written, strict=True)
        ]
    rows = [tuple(None if cell == "" else cell for cell in row) for row in rows]
    return [row for row in rows if _holds(row)]


def _rows(path: Path, calculated: bool) -> list[tuple[object, ...]]:
    """Return all rows, with the values of formulas or with their text."""
    from openpyxl import load_workbook

    workbook = load_workbook(path, read_only=True, data_only=calculated)
    try:
        sheet = workbook.worksheets[0]
        stated = sheet.max_column or 0
        sheet.reset_dimensions()  # some programs state it too small, which would lose rows
        rows = [tuple(map(_content, row)) for row in sheet.iter_rows()]
        return [row + (None,) * (stated - len(row)) for row in rows]
    finally:
        workbook.close()


def _content(cell: Any) -> object:
    """Return a cell's content; openpyxl leaves out the value of a formula with an empty text."""
    if cell.value is None and cell.data_type == "str":
        return ""
    return getattr(cell.value, "text", cell.value)  # an array formula is an object


def _refuse_unnamed(path: Path, count: int, rows: Sequence[Sequence[object]]) -> None:
    """Raise a UserError if the sheet has more than `count` columns, as the names may not match."""
    width = max((len(_filled(row)) for row in rows), default=0)
    if width > count:
        raise UserError(
            f"{path}: {count} columns are named, but the first sheet has {width}; name all of "
            "them under record_format in specimen.yaml, from left to right, '-' to leave one out"
        )


def _filled(row: Sequence[object]) -> list[str]:
    """Return the cells up to the last filled one."""
    last = max((i for i, cell in enumerate(row) if cell is not None), default=-1)
    return [str(cell) for cell in row[: last + 1]]


def _header(row: Sequence[object], path: Path, named: Sequence[Column] | None) -> list[Column]:
    columns = renamed(from_header(row), named, str(path))
    if row and all(column.unit is None for column in columns):
        cells = [str(cell) for cell in row if cell is not None]
        hint = unit_hint(cells) or "; write it as 'time [s]', 'voltage [kV]'"
        raise UserError(
            f"{path}: no column of the first row {', '.join(cells)[:60]!r} has a unit{hint}; "
            "remove titles above it, or count them as header_lines"
        )
    return columns


def _holds(row: Sequence[object]) -> bool:
    return any(cell is not None for cell in row) and not COMMENT.match(str(row[0] or ""))


def _cells(values: Sequence[object]) -> NDArray[Any]:
    """Return cells as floats if all are numbers, else unchanged."""
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.asarray([np.nan if value is None else value for value in values], dtype=float)
    return np.asarray(values, dtype=object)
