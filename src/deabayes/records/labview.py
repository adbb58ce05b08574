"""Read LabVIEW measurement files (.lvm), whose head states units, sampling and decimal sign.

The format: NI, "Specification for the LabVIEW Measurement File (.lvm)", 2013.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deabayes.faults import UserError
from deabayes.records.columns import Column, Table, from_header, renamed
from deabayes.records.layout import is_number
from deabayes.records.opening import open_text
from deabayes.records.text import peek, read_columns

FIRST = "LabVIEW Measurement"
NAMES = "X_Value"
"""First cell of the row of names, which is the last row of the head."""
SEPARATOR, END_OF_HEAD = "Separator", b"***End_of_Header***"
LONGEST_HEAD = 2**16
"""Bytes in which a head ends."""


def is_labview(path: Path) -> bool:
    """Whether a file begins with the head of a LabVIEW measurement file.

    Other files may have the same first line, and then a table.
    """
    with path.open("rb") as file:
        head = file.read(LONGEST_HEAD)
    begins = head[: len(FIRST) + 3].decode("utf-8-sig", errors="replace").startswith(FIRST)
    return begins and END_OF_HEAD in head


def read_labview(
    path: Path, record_format: Mapping[str, Any] | None, named: Sequence[Column] | None
) -> Table:
    """Read the channels, with the units of `Y_Unit_Label`, and the time.

    Time is the column `X_Value`, or comes from `X0` and `Delta_X`.

    Parameters
    ----------
    named : names and units that experiments.csv gives to channels.

    Raises
    ------
    UserError : no row of names, several segments, channels of different sampling.
    """
    stream = open_text(path, record_format or {})
    if stream.getvalue().count(END_OF_HEAD) > 2:
        raise UserError(f"{path}: holds several measurements; save each as a file of its own")
    head, names, separator = _head(stream, path)
    decimal = (head.get("Decimal_Separator") or ["."])[0] or "."
    columns = _columns(head, names, path)
    if not peek(stream, 1):
        raise UserError(f"{path}: holds no data rows after its head; copy the record again")
    table = read_columns(stream, path, columns, separator, decimal, 1 if "Comment" in names else 0)
    if _stated(head, "X_Columns") == "No":
        table = _with_time(table, head, decimal, path)
    return replace(table, columns=renamed(list(table.columns), named, str(path)))


def _head(stream: io.BytesIO, path: Path) -> tuple[dict[str, list[str]], list[str], str]:
    """Return the cells behind each key, the names of the columns, and the separator."""
    head: dict[str, list[str]] = {}
    separator = "\t"
    for raw in iter(stream.readline, b""):
        line = raw.decode("utf-8", errors="replace").rstrip("\n")
        if line.startswith(SEPARATOR):
            separator = line[len(SEPARATOR) : len(SEPARATOR) + 1]
        key, *cells = (cell.strip() for cell in line.split(separator))
        if key == NAMES:
            return head, [key, *cells], separator
        head[key] = cells
    raise UserError(f"{path}: has no row of names ({NAMES} ...); copy the record again")


def _stated(head: Mapping[str, Sequence[str]], key: str) -> str:
    return next(iter(head.get(key, ())), "")


def _columns(head: Mapping[str, Sequence[str]], names: Sequence[str], path: Path) -> list[Column]:
    if _stated(head, "X_Columns") == "Multi":
        raise UserError(f"{path}: has a time for each channel (X_Columns: Multi); save it with one")
    is_time = set(filter(None, head.get("X_Dimension", ("Time",)))) == {"Time"}
    has_times = _stated(head, "X_Columns") != "No"
    first = Column("time", "s", source=NAMES) if is_time and has_times else Column(None, None)
    channels = [name for name in names[1:] if name not in ("", "Comment")]
    return [first, *from_header(channels, head.get("Y_Unit_Label"))]


def _with_time(table: Table, head: Mapping[str, Sequence[str]], decimal: str, path: Path) -> Table:
    """Return the table with the times that its head states."""
    stated = [
        {cell.replace(decimal, ".") for cell in head.get(key, ()) if cell}
        for key in ("X0", "Delta_X")
    ]
    if any(len(cells) != 1 or not all(map(is_number, cells)) for cells in stated):
        raise UserError(
            f"{path}: its channels have no common X0 and Delta_X; save it with a time column"
        )
    start, interval = (float(cells.pop()) for cells in stated)
    time = start + interval * np.arange(table.arrays[0].size, dtype=float)
    columns = [Column("time", "s"), *table.columns[1:]]
    note = f"time from X0 and Delta_X: every {interval:g} s, from {start:g} s"
    return replace(table, columns=columns, arrays=[time, *table.arrays[1:]], notes=[note])
