"""Find the header, the row of units and the first data row of a table of text cells."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from deabayes.units import USUAL_UNITS, same_dimension

MISSING = ("", *"nan NaN NAN -nan -NaN NA N/A n/a <NA> None null NULL".split())
"""Cells without a value."""
LOOKED_AT = 300
"""Rows in which the header is searched; exports have less above it."""
ENCLOSED = re.compile(r"\s*(?:\((?P<round>[^()]*)\)|\[(?P<square>[^\[\]]*)\])\s*")
NO_UNIT = ("", "-", "%", "1")
"""Cells of a row of units that do not show that it is one."""


@dataclass(frozen=True)
class Layout:
    """Where a table begins.

    Attributes
    ----------
    header : index of the row of names.
    units : the units in the row below the names, None if there is no such row.
    """

    header: int
    units: Sequence[str] | None = None

    @property
    def data(self) -> int:
        """Index of the first data row."""
        return self.header + (1 if self.units is None else 2)


def find_layout(rows: Sequence[Sequence[str]]) -> Layout | None:
    """Return the layout of a table from its first rows, None if it is not certain.

    It is certain if rows of numbers end the list, if the row above them holds texts only, and if no
    row further up looks like them.
    """
    numeric, last = numeric_columns(rows)
    if not numeric:
        return None
    first = last
    while first > 0 and _has_number(rows[first - 1], numeric):
        first -= 1
    header, units = first - 1, None
    if header > 0 and _names(rows[header - 1]):
        units = units_in(rows[header], len(rows[header - 1]))
        header -= units is not None
    if header < 0 or not _names(rows[header]):
        return None
    if any(is_like(row, rows[first]) for row in rows[:header]):
        return None
    return Layout(header, units)


def units_in(cells: Sequence[str], width: int) -> list[str] | None:
    """Return the units of a row that holds nothing else, without their brackets; else None."""
    found = [unit_in(cell) for cell in cells]
    if len(filled(cells)) > width or not any(cells):
        return None
    units = [unit for unit in found if unit is not None]
    if len(units) < len(found) or all(unit in NO_UNIT for unit in units):
        return None
    return units + [""] * (width - len(units))


def unit_in(cell: str) -> str | None:
    """Return the unit that is all of a cell, with or without brackets; None if it is no unit.

    A number without brackets is data. A single letter without brackets may be a name, such as t.
    """
    match = ENCLOSED.fullmatch(cell)
    if is_number(cell):
        return None
    unit = (cell if match is None else match["round"] or match["square"] or "").strip()
    sure = unit in (*USUAL_UNITS, *NO_UNIT)
    return unit if sure or ((match or len(unit) > 1) and same_dimension(unit, unit)) else None


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def is_like(cells: Sequence[str], data: Sequence[str]) -> bool:
    """Whether a row has numbers, or no value, in the columns in which a data row has numbers."""
    numeric = [i for i, cell in enumerate(data) if is_number(cell) and cell not in MISSING]
    there = [cells[i] for i in numeric if i < len(cells)]
    return (
        any(map(is_number, there))
        and len(there) == len(numeric)
        and len(filled(cells)) <= len(data)
        and all(is_number(cell) or cell in MISSING for cell in there)
    )


def filled(cells: Sequence[str]) -> Sequence[str]:
    """Return the cells up to the last that is not empty."""
    return cells[: max((i for i, cell in enumerate(cells) if cell), default=-1) + 1]


def numeric_columns(rows: Sequence[Sequence[str]]) -> tuple[list[int], int]:
    """Return the columns of numbers, none in a single column, and the row that shows them.

    The very last row may be cut short, so the one before it is preferred.
    """
    for index in range(len(rows) - 2, len(rows)):
        cells = rows[index] if index >= 0 else ()
        numeric = [i for i, cell in enumerate(cells) if is_number(cell)]
        if numeric and len(cells) > 1:
            return numeric, index
    return [], 0


def _has_number(cells: Sequence[str], numeric: Sequence[int]) -> bool:
    return any(is_number(cells[i]) for i in numeric if i < len(cells))


def _names(cells: Sequence[str]) -> bool:
    """Whether a row can hold the names of columns."""
    return len(filled(cells)) > 1 and not any(map(is_number, cells))
