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
)
from deabayes.records.layout import LOOKED_AT, filled, find_layout, units_in
from deabayes.records.matlab import opened
from deabayes.records.text import refuse_skipped_data


def read_xlsx(
    path: Path,
    record_format: Mapping[str, Any] | None = None,
    named: Sequence[Column] | None = None,
) -> Table:
    """Read the first sheet; its first row, or the first below `header_lines`, is the header.

    Rows above the header are left out where it is certain which row that is. Empty rows and
    comments do not count. `named` holds names and units that experiments.csv gives to columns of
    the header.
    """
    rows = opened(_first_sheet, path, "an Excel file")
    header_lines = int((record_format or {}).get("header_lines", 0))
    skipped, rows = rows[:header_lines], rows[header_lines:]
    notes: list[str] = []
    columns = from_format(record_format)
    if columns is None:
        columns, rows, notes = _header(rows, path, named)
    else:
        refuse_skipped_data([_texts(r) for r in skipped], [_texts(r) for r in rows[:1]], path)
        _refuse_unnamed(path, len(columns), rows)
        columns = renamed(columns, named, str(path))
    if not rows:
        raise UserError(f"{path}: the first sheet holds no data rows; copy the record again")
    width = max(map(len, rows))
    if width < len(columns):
        raise UserError(
            f"{path}: {len(columns)} columns are named, but the first sheet has {width}"
        )
    cells = zip(*(row + (None,) * (width - len(row)) for row in rows), strict=True)
    arrays = [_cells(values) for _, values in zip(columns, cells, strict=False)]
    return Table(columns, arrays, notes=notes)


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
    width = max((len(filled(_texts(row))) for row in rows), default=0)
    if width > count:
        raise UserError(
            f"{path}: {count} columns are named, but the first sheet has {width}; name all of "
            "them under record_format in specimen.yaml, from left to right, '-' to leave one out"
        )


def _texts(row: Sequence[object]) -> list[str]:
    """Return the cells as text, an empty one as an empty text."""
    return ["" if cell is None else " ".join(str(cell).split()) for cell in row]


def _header(
    rows: list[tuple[object, ...]], path: Path, named: Sequence[Column] | None
) -> tuple[list[Column], list[tuple[object, ...]], list[str]]:
    """Return the columns, the rows below the header and its units, and notes."""
    texts = [_texts(row) for row in rows[:LOOKED_AT]]
    layout = find_layout(texts)
    above = 0 if layout is None else layout.header
    if not rows:
        return [], [], []
    width = len(texts[above])
    units = units_in(texts[above + 1], width) if above + 1 < len(texts) else None
    notes = []
    if above or units is not None:
        below = "" if units is None else " and a row of units"
        header = ", ".join(filled(texts[above]))[:60]
        left_out = "; what is above it is left out" if above else ""
        notes = [f"header {header!r}{below}{left_out}"]
    columns = renamed(from_header(rows[above], units), named, str(path))
    return columns, rows[above + (1 if units is None else 2) :], notes


def _holds(row: Sequence[object]) -> bool:
    return any(cell is not None for cell in row) and not COMMENT.match(str(row[0] or ""))


def _cells(values: Sequence[object]) -> NDArray[Any]:
    """Return cells as floats if all are numbers, else unchanged."""
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.asarray([np.nan if value is None else value for value in values], dtype=float)
    return np.asarray(values, dtype=object)
