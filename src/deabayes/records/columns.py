"""Names and units of a record's columns, from its file, specimen.yaml or experiments.csv."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Role
from deabayes.faults import UserError
from deabayes.units import same_dimension


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
    notes : how the file was read, where that is more than a header of ``name [unit]``.
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]
    sha256: str
    left_out: int = 0
    warnings: Mapping[str, Sequence[str]] = field(default_factory=dict)
    notes: Sequence[str] = ()


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
UNIT_IN_PARENTHESES = re.compile(r"^(?P<name>.*?)\s*\((?P<unit>[^()\d][^()]*)\)$")
STRAIN = re.compile(r"^(?P<name>.*?)\s*-\s*1$")
"""``stretch - 1``: a column that holds a strain where a stretch is needed."""
UNKNOWN_UNIT = "?"
"""Stands for a unit that the file does not state, in columns that `deabayes` proposes."""
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
    source : the name in the file, if it differs from `name`.
    """

    name: str | None
    unit: str | None
    offset: float = 0.0
    source: str | None = None


@dataclass(frozen=True)
class Table:
    """Content of a file before conversion: one array per column.

    `decimal` is the decimal sign of numbers in text columns; `notes` are those of `RawRecord`.
    """

    columns: Sequence[Column]
    arrays: Sequence[NDArray[Any]]
    decimal: str = "."
    notes: Sequence[str] = ()


def from_header(cells: Iterable[object], units: Sequence[str] | None = None) -> list[Column]:
    """Make columns from header cells such as ``time [s]`` or ``Time (s)``.

    Cells may contain line breaks. Round brackets hold a unit only if it is a known one.

    Parameters
    ----------
    units : units of the columns from a row of their own; those in the header come first.
    """
    columns = []
    for index, cell in enumerate(cells):
        text = " ".join(str(cell if cell is not None else "").split())
        match = HEADER_CELL.match(text)
        assert match is not None  # every part of the pattern is optional
        name, unit = match["name"] or None, match["unit"]
        enclosed = UNIT_IN_PARENTHESES.match(text)
        if unit is None and enclosed and is_unit(enclosed["unit"]):
            name, unit = enclosed["name"] or None, enclosed["unit"]
        if unit is None and units is not None and name and index < len(units):
            unit = units[index] or None
        columns.append(Column(name, unit, source=text or None))
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
        source = given.source or given.name or ""
        places = _places(columns, source)
        if len(places) != 1:
            known = ", ".join(repr(c.name) for c in columns if c.name)
            raise UserError(
                f"{where}: {'two columns are' if places else 'no column is'} called {source!r}, as "
                f"`columns` in experiments.csv says (there are {known}); correct one of them"
            )
        old = columns[places[0]]
        unit = old.unit if given.unit is None else given.unit
        columns_renamed[places[0]] = replace(
            old, name=given.name, unit=unit, offset=given.offset, source=old.source or old.name
        )
    return columns_renamed


def _places(columns: Sequence[Column], text: str) -> list[int]:
    """Return the columns that a text names: whole, by their name, or but for capitals."""
    name = from_header([text])[0].name or ""
    whole = [i for i, column in enumerate(columns) if column.source == text]
    by_name = [i for i, column in enumerate(columns) if name in (column.name, column.source)]
    alike = [i for i, c in enumerate(columns) if name.lower() == (c.name or "").lower()]
    return whole or by_name or alike


def from_text(text: str) -> list[Column]:
    """Make columns from a cell of experiments.csv: ``t = time [s]; voltage [kV]``.

    ``Strain = stretch - 1 [%]`` reads a strain as a stretch.
    """
    columns = []
    for part in filter(None, (part.strip() for part in text.split(";"))):
        source, equals, cell = part.partition("=")
        column = from_header([cell if equals else part])[0]
        strain = STRAIN.match(column.name or "")
        if strain:
            column = replace(column, name=strain["name"], offset=1.0)
        columns.append(replace(column, source=source.strip() if equals else None))
    return columns


def with_channel_names(columns: Sequence[Column], channels: Collection[str]) -> list[Column]:
    """Give columns the names of channels that they have but for capitals and blanks.

    A column ``Time (s)`` becomes `time`, unless another column is called `time` as it is.
    """
    taken = {column.name for column in columns}
    renamed_columns = []
    for column in columns:
        name = "_".join((column.name or "").lower().split())
        if name in channels and name not in taken:
            column = replace(column, name=name, source=column.source or column.name)
        renamed_columns.append(column)
    return renamed_columns


def is_unit(unit: str | None) -> bool:
    """Whether a text is a known unit."""
    return unit is not None and same_dimension(unit, unit)
