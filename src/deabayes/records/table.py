"""Read experiments.csv, with one row per record, and choose the rows of a study."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from deabayes.experiment import FREQUENCY_RESPONSE, PHASE, Role
from deabayes.faults import Faults, UserError, nearest, rename_hint
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.records.lines import DELIMITERS, is_number
from deabayes.records.schema import schema, violations
from deabayes.systems import system_class

NUMBERS = ("load_g", "bias_kV", "voltage_kV", "frequency_Hz", "amplitude_kV")
READ_BY_MODELS = (*NUMBERS, "deformation", "prehistory", "columns")
"""Optional columns that models or readers use if present."""
OF_ANY_RECORD = ("frequency_Hz", "columns")
OF_A_VOLTAGE = ("voltage_kV", "amplitude_kV")
ALIKE = 0.82
"""Similarity above which an unknown name counts as a misspelt column."""


def header_faults(header: list[str], path: Path) -> list[str]:
    """Faults of the header: columns missing, given twice, or not separated."""
    required = schema("experiments")["required"]
    missing = [name for name in required if name not in header]
    unknown = [h for h in header if h and h not in (*required, *READ_BY_MODELS, "note")]
    faults = [
        f"{path}: column {name!r} is missing{rename_hint(name, unknown) or '; add it'}"
        for name in missing
    ]
    if missing and len(header) == 1:
        return [f"{path}: only one column found; separate columns with a comma, ';' or a tab"]
    repeated = [name for name, count in Counter(h for h in header if h).items() if count > 1]
    return faults + [f"{path}: column {name!r} occurs twice; remove one" for name in repeated]


def misspelt(header: list[str], path: Path, system: str | None) -> list[str]:
    """Faults: columns that would be ignored because of their spelling or unit."""
    spelling = {name.lower(): name for name in READ_BY_MODELS}
    read = {name.lower(): name for name in _read_by(system)}
    stems = {name.partition("_")[0]: name for name in read.values()}
    faults = []
    for name in header:
        low = name.lower()
        close = [read[each] for each in get_close_matches(low, read, 1, ALIKE)]
        meant = spelling.get(low) or stems.get(low) or next(iter(close), None)
        if meant and name not in READ_BY_MODELS and meant not in header:
            faults.append(
                f"{path}: no model reads column {name!r}; did you mean {meant!r}? Rename it so, "
                "with values in that unit, or give it a less similar name"
            )
    return faults


def _read_by(system: str | None) -> tuple[str, ...]:
    """Columns whose misspelling matters to a system; none for a user's own system."""
    from deabayes.systems import OWN, REGISTRY

    if system in OWN:
        return ()
    if system not in REGISTRY:
        return READ_BY_MODELS
    kind = system_class(system)
    held = {name for names in (kind.conditions or {}).values() for name in names}
    driven = OF_A_VOLTAGE if "voltage" in {*held, *kind.excitations} else ()
    return tuple(n for n in READ_BY_MODELS if n in (*held, *driven, *OF_ANY_RECORD))


FILE = "experiments.csv"
WITHOUT_TIME = ("quasi_static", "frequency_response")


def read_table(folder: Path, system: str | None = None) -> list[ExperimentRow]:
    """Return all rows of experiments.csv.

    Raises
    ------
    Faults : every fault of every row, from `scan_table`.
    """
    rows, faults = scan_table(folder, system)
    if faults:
        raise Faults(faults)
    return rows


def scan_table(folder: Path, system: str | None = None) -> tuple[list[ExperimentRow], list[str]]:
    """Return the sound rows of experiments.csv, and every fault of the others with its line.

    Parameters
    ----------
    folder : study folder.
    system : name of the system, to check protocols and channels; None skips these checks.
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
    """Column that models read as a number -> the fault, if its cell is no number."""
    return {
        name: f"{where}, {name}: expected a number, found '{value}'; {_remedy(name, str(value))}, "
        "or leave the cell empty"
        for name, value in content.items()
        if name in NUMBERS and not (isinstance(value, float) and math.isfinite(value))
    }


def _remedy(name: str, cell: str) -> str:
    """Say how to write a number in place of a text."""
    plain = cell.replace(",", ".")
    if "," in cell and is_number(plain):
        return f"write {plain}, with a decimal point"
    return f"give one in {name.rpartition('_')[2]}, without its unit"


def _read_cells(path: Path) -> tuple[list[int], list[str], list[list[str]], str]:
    """Return line numbers, header, cells and delimiter, without empty lines and comments."""
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
    """Return line number -> cells, without empty lines and comments."""
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
    """Return a row's filled cells by column; metadata are numbers where possible."""
    texts = ("name", "protocol", "record", "role", "excitation", "response", "note", "columns")
    content: dict[str, Any] = {}
    for name, cell in zip(header, values, strict=False):
        if name and cell:
            content[name] = cell if name in texts else number_or_text(cell)
    return content


def number_or_text(cell: str) -> float | str:
    """Return a cell as a number if possible, else as text."""
    try:
        return float(cell)
    except ValueError:
        return cell


def _row(content: Mapping[str, Any]) -> ExperimentRow:
    fixed = ("name", "protocol", "record", "role", "excitation", "response")
    metadata = {key: value for key, value in content.items() if key not in fixed}
    return ExperimentRow(**{key: content[key] for key in fixed}, metadata=metadata)


def channels_of(system: str, protocol: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the excitations and responses of a system for one protocol, with SI units.

    A command is included if the excitation that it asks for drives the system in time.
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


def measured_rows(row: ExperimentRow, raw: RawRecord) -> list[ExperimentRow]:
    """Return the measurements that a row of experiments.csv describes, itself first.

    The gain of a frequency response adds the phase of the same record, named `NAME_phase`.
    """
    if (row.protocol, row.response) != ("frequency_response", "gain") or "phase" not in raw.columns:
        return [row]
    return [row, replace(row, name=f"{row.name}{PHASE}", response="phase")]


def told_apart_by(row: ExperimentRow) -> dict[str, float | str]:
    """Return the row's values by column, for `select` and `split_by`."""
    named = {"protocol": row.protocol, "excitation": row.excitation, "response": row.response}
    return {**named, **row.metadata}


def values_of(folder: Path, column: str) -> list[str]:
    """Return the distinct values of a column in order of appearance (for `split_by`)."""
    rows = {row.name: told_apart_by(row) for row in read_table(folder)}
    known = dict.fromkeys(key for values in rows.values() for key in values)
    if column not in known:
        hint = nearest(column, known)
        raise UserError(f"{Path(folder) / FILE}: has no column {column!r} to split by{hint}")
    missing = [name for name, values in rows.items() if column not in values]
    if missing:
        raise UserError(
            f"{Path(folder) / FILE}: column {column!r} is empty for {', '.join(missing)}; "
            "fill it in"
        )
    return list(dict.fromkeys(str(values[column]) for values in rows.values()))


def selected(rows: Iterable[ExperimentRow], wanted: Mapping[str, str]) -> list[ExperimentRow]:
    """Return the rows whose columns have the wanted values; numbers compare by value."""
    return [
        row
        for row in rows
        if all(
            told_apart_by(row).get(column) in (value, number_or_text(value))
            for column, value in wanted.items()
        )
    ]


def none_to_fit(folder: Path, calibrate: object, validate: object) -> str:
    """Message for a study whose two lists leave no row to calibrate on."""
    todo = "give one the role `calibrate` in experiments.csv"
    if calibrate is not None or validate:
        todo = "name one of its records under `calibrate`, and not under `validate`"
    return f"no record to calibrate on in {folder}; {todo}"


def in_roles(
    rows: Iterable[ExperimentRow],
    calibrate: Collection[str] | None,
    validate: Collection[str] | None,
) -> list[ExperimentRow]:
    """Return the rows to calibrate on, then the held-out rows, each in its role in the study.

    A listed name has the role of its list. A role without a list (None) takes the rows with that
    role in experiments.csv, except those that the other list names.
    """
    lists: Mapping[Role, Collection[str] | None]
    lists = {"calibrate": calibrate, "validate": validate}
    listed = {name: role for role, names in lists.items() for name in names or ()}
    used = [
        replace(row, role=listed.get(row.name, row.role))
        for row in rows
        if row.name in listed or lists[row.role] is None
    ]
    return sorted(used, key=lambda row: list(lists).index(row.role))
