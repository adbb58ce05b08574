"""experiments.csv: one row per record."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deabayes.experiment import FREQUENCY_RESPONSE
from deabayes.faults import Faults, UserError, nearest
from deabayes.reading.cells import DELIMITERS, is_number
from deabayes.reading.columns import COMMANDS
from deabayes.reading.raw import ExperimentRow
from deabayes.reading.schema import violations
from deabayes.systems import system_class
from deabayes.reading.table_header import NUMBERS, header_faults, misspelt

FILE = "experiments.csv"
WITHOUT_TIME = ("quasi_static", "frequency_response")


def read_table(folder: Path, system: str | None = None) -> list[ExperimentRow]:
    """All rows of experiments.csv.

    Raises
    ------
    Faults : every fault of every row, as `scan_table` finds them.
    """
    rows, faults = scan_table(folder, system)
    if faults:
        raise Faults(faults)
    return rows


def scan_table(folder: Path, system: str | None = None) -> tuple[list[ExperimentRow], list[str]]:
    """The sound rows of experiments.csv, and every fault of the others with its line.

    Parameters
    ----------
    folder : study folder.
    system : name of the system, to check protocols and channels against; None skips that.
    """
    path = Path(folder) / FILE
    try:
        lines, header, cells, delimiter = _read_cells(path)
    except UserError as error:
        return [], [str(error)]
    faults = header_faults(header, path)
    if faults:
        return [], faults
    faults = misspelt(header, path, system)
    rows: list[ExperimentRow] = []
    for line, values in zip(lines, cells, strict=True):
        where = f"{path}, line {line}"
        content = _content(header, values)
        no_numbers = _no_numbers(content, where)
        sound = {name: cell for name, cell in content.items() if name not in no_numbers}
        wrong = _too_many(header, values, delimiter, where) + violations(
            sound, "experiments", where
        )
        wrong += no_numbers.values()
        row = None if wrong else _row(content)
        if row is not None and system is not None:
            wrong = _system_faults(row, system, where)
        faults += wrong
        rows += [row] if row is not None and not wrong else []
    if not cells:
        faults.append(f"{path}: lists no record; add a row per record below the header")
    return rows, faults + _repeated(rows, path)


def _too_many(header: list[str], values: list[str], delimiter: str, where: str) -> list[str]:
    if any(values[len(header) :]):
        mark = {",": "a comma", "\t": "a tab"}.get(delimiter, repr(delimiter))
        return [
            f"{where}: has {len(values)} cells under {len(header)} columns; put a text that "
            f'holds {mark} in "quotation marks"'
        ]
    return []


def _no_numbers(content: Mapping[str, Any], where: str) -> dict[str, str]:
    """Columns that models read as numbers and that hold none -> the fault."""
    return {
        name: f"{where}, {name}: expected a number, found '{value}'; {_remedy(name, str(value))}, "
        "or leave the cell empty"
        for name, value in content.items()
        if name in NUMBERS and not (isinstance(value, float) and math.isfinite(value))
    }


def _remedy(name: str, cell: str) -> str:
    """How to write a number in place of a text."""
    plain = cell.replace(",", ".")
    if "," in cell and is_number(plain):
        return f"write {plain}, with a decimal point"
    return f"give one in {name.rpartition('_')[2]}, without its unit"


def _read_cells(path: Path) -> tuple[list[int], list[str], list[list[str]], str]:
    """Line numbers, header, cells and delimiter; empty lines and comments left out."""
    if not path.is_file():
        raise UserError(f"{path}: there is no such file; write one row per record into it")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise UserError(f"{path}: is not UTF-8 (byte 0x{byte:02x}); save it as UTF-8") from None
    plain = [line for line in text.split("\n") if line.strip(" ,;\t") and not _is_comment(line)]
    delimiter = max(DELIMITERS, key=(plain or [""])[0].count)
    rows = _rows(text, delimiter, path) if plain else {}
    if not rows:
        raise UserError(f"{path}: the file is empty; write a header and one row per record into it")
    lines = list(rows)[1:]
    return lines, next(iter(rows.values())), [rows[line] for line in lines], delimiter


def _rows(text: str, delimiter: str, path: Path) -> dict[int, list[str]]:
    """Cells by the line they begin in, without empty lines and comments."""
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, strict=True)
    rows: dict[int, list[str]] = {}
    line = 1
    try:
        for cells in reader:
            rows[line] = [cell.strip() for cell in cells]
            line = reader.line_num + 1
    except csv.Error as error:
        raise UserError(
            f"{path}, line {line}: a quotation mark has no end, or text behind it ({error}); write "
            "it twice within a quoted cell, else remove it"
        ) from None
    return {n: cells for n, cells in rows.items() if any(cells) and not _is_comment(cells[0])}


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _content(header: list[str], values: list[str]) -> dict[str, Any]:
    """A row's filled cells by column; metadata that reads as a number is one."""
    texts = ("name", "protocol", "record", "role", "excitation", "response", "note", "columns")
    content: dict[str, Any] = {}
    for name, cell in zip(header, values, strict=False):
        if name and cell:
            content[name] = cell if name in texts else number_or_text(cell)
    return content


def number_or_text(cell: str) -> float | str:
    """The number that a cell reads as, else its text."""
    try:
        return float(cell)
    except ValueError:
        return cell


def _row(content: Mapping[str, Any]) -> ExperimentRow:
    fixed = ("name", "protocol", "record", "role", "excitation", "response")
    metadata = {key: value for key, value in content.items() if key not in fixed}
    return ExperimentRow(**{key: content[key] for key in fixed}, metadata=metadata)


def channels_of(system: str, protocol: str) -> tuple[dict[str, str], dict[str, str]]:
    """Excitation and response channels of a system -> SI units, for one protocol.

    A command stands for the excitation that it asks for, where that drives the system in time.
    """
    kind = system_class(system)
    commands = {name: kind.excitations[of] for name, of in COMMANDS.items() if of in kind.in_time}
    harmonic = protocol == "frequency_response"
    excitations, responses = (
        {name: unit for name, unit in known.items() if (name in FREQUENCY_RESPONSE) == harmonic}
        for known in ({**kind.excitations, **commands}, kind.responses)
    )
    return excitations, responses


def _system_faults(row: ExperimentRow, system: str, where: str) -> list[str]:
    kind = system_class(system)
    place = f"{where} ({row.name})"
    if row.protocol not in kind.protocols:
        known = ", ".join(kind.protocols)
        return [
            f"{place}: system {system!r} has no model of protocol {row.protocol!r} "
            f"(it has {known}); correct or remove the row"
        ]
    excitations, responses = channels_of(system, row.protocol)
    faults = []
    for key, name, known_channels in (
        ("excitation", row.excitation, excitations),
        ("response", row.response, responses),
    ):
        if name not in known_channels:
            hint = nearest(name, known_channels)
            faults.append(f"{place}: system {system!r} has no {key} {name!r}{hint}")
    return faults


def _repeated(rows: list[ExperimentRow], path: Path) -> list[str]:
    names = Counter(row.name.lower() for row in rows)
    return [
        f"{path}: {count} rows are named {name!r} (upper and lower case count as one); rename them"
        for name, count in names.items()
        if count > 1
    ]
