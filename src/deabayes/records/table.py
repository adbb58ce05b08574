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
from deabayes.faults import Report, UserError, nearest, rename_hint
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.records.layout import is_number
from deabayes.records.marks import confirm, without_marks
from deabayes.records.schema import schema, violations
from deabayes.records.text import DELIMITERS
from deabayes.systems import system_class

FILE = "experiments.csv"
WITHOUT_TIME = ("quasi_static", "frequency_response")
FIXED = ("name", "protocol", "record", "role", "excitation", "response")
TEXTS = (*FIXED, "note", "columns")
NUMBERS = ("load_g", "bias_kV", "voltage_kV", "frequency_Hz", "amplitude_kV")
READ_BY_MODELS = (*NUMBERS, "deformation", "prehistory", "columns")
"""Optional columns that models or readers use if present."""
OF_ANY_RECORD = ("frequency_Hz", "columns")
OF_A_VOLTAGE = ("voltage_kV", "amplitude_kV")
ALIKE = 0.82
"""Similarity above which an unknown name counts as a misspelt column."""


def _check_header(header: list[str], place: str) -> None:
    """Raise the faults of a header: columns that are missing, given twice, or not separated."""
    report, required = Report(place), schema("experiments")["required"]
    missing = [name for name in required if name not in header]
    unknown = [h for h in header if h and h not in (*required, *READ_BY_MODELS, "note")]
    if missing and len(header) == 1:
        raise UserError(
            f"{place}: only one column found; separate columns with a comma, ';' or a tab"
        )
    for name in missing:
        report.fault(f"column {name!r} is missing{rename_hint(name, unknown) or '; add it'}")
    for name, count in Counter(filter(None, header)).items():
        if count > 1:
            report.fault(f"column {name!r} occurs twice; remove one")
    report.raise_faults()


def _check_spelling(header: list[str], system: str | None, report: Report) -> None:
    """Report columns that would be ignored because of their spelling or unit."""
    spelling = {name.lower(): name for name in READ_BY_MODELS}
    read = {name.lower(): name for name in _read_by(system)}
    stems = {name.partition("_")[0]: name for name in read.values()}
    for name in header:
        low = name.lower()
        close = [read[other] for other in get_close_matches(low, read, 1, ALIKE)]
        meant = spelling.get(low) or stems.get(low) or next(iter(close), None)
        if meant and name not in READ_BY_MODELS and meant not in header:
            report.fault(
                f"no model reads column {name!r}; did you mean {meant!r}? Rename it so, with "
                "values in that unit, or give it a less similar name"
            )


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


def read_table(folder: Path, system: str | None = None) -> list[ExperimentRow]:
    """Return all rows of experiments.csv.

    Raises
    ------
    Faults : every fault of every row, from `scan_table`.
    """
    report = Report()
    rows = scan_table(folder, report, system)
    report.raise_faults()
    return rows


def scan_table(folder: Path, report: Report, system: str | None = None) -> list[ExperimentRow]:
    """Return the sound rows of experiments.csv, and report every fault of the others.

    Parameters
    ----------
    folder : study folder.
    system : name of the system, to check protocols and channels; None skips these checks.
    """
    path = Path(folder) / FILE
    table = report.at(str(path))
    rows: list[ExperimentRow] = []
    guessed: dict[str, list[int]] = {}
    with report.catching():
        lines, header, cells, delimiter = _read_cells(path)
        _check_header(header, str(path))
        _check_spelling(header, system, table)
        if not cells:
            table.fault("lists no record; add a row per record below the header")
        for line, values in zip(lines, cells, strict=True):
            bare, guesses = _without_marks(header, values)
            with report.catching():
                rows.append(_read_row(header, bare, delimiter, system, f"{path}, line {line}"))
            if guesses:
                guessed.setdefault(confirm(guesses), []).append(line)
    for message, places in guessed.items():
        table.fault(message, f"line{'s' * bool(places[1:])} {', '.join(map(str, places))}")
    for name, count in Counter(row.name.lower() for row in rows).items():
        if count > 1:
            table.fault(
                f"{count} rows are named {name!r} (upper and lower case count as one); rename them"
            )
    return rows


def _without_marks(header: list[str], values: list[str]) -> tuple[list[str], list[str]]:
    """Return a row without the marks of guesses, and ``column value`` for each of these."""
    bare, guesses = list(values), []
    for index, (name, cell) in enumerate(zip(header, values, strict=False)):
        if name in (*FIXED, *READ_BY_MODELS):
            bare[index], found = without_marks(cell)
            guesses += [f"{name} {guess}" for guess in found]
    return bare, guesses


def _read_row(
    header: list[str], values: list[str], delimiter: str, system: str | None, place: str
) -> ExperimentRow:
    """Return a row without faults.

    Raises
    ------
    Faults : every fault of the row.
    """
    report, content = Report(place), _content(header, values)
    if any(values[len(header) :]):
        mark = {",": "a comma", "\t": "a tab"}.get(delimiter, repr(delimiter))
        report.fault(
            f"has {len(values)} cells under {len(header)} columns; put a text that holds {mark} "
            'in "quotation marks"'
        )
    no_numbers = {
        name: str(value)
        for name, value in content.items()
        if name in NUMBERS and not (isinstance(value, float) and math.isfinite(value))
    }
    sound = {name: cell for name, cell in content.items() if name not in no_numbers}
    report.faults += violations(sound, "experiments", place)
    for name, cell in no_numbers.items():
        remedy = f"{_remedy(name, cell)}, or leave the cell empty"
        report.fault(f"expected a number, found '{cell}'; {remedy}", name)
    report.raise_faults()
    metadata = {key: value for key, value in content.items() if key not in FIXED}
    row = ExperimentRow(**{key: content[key] for key in FIXED}, metadata=metadata)
    if system is not None:
        _check_system(row, system, Report(f"{place} ({row.name})"))
    return row


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
    content: dict[str, Any] = {}
    for name, cell in zip(header, values, strict=False):
        if name and cell:
            content[name] = cell if name in TEXTS else number_or_text(cell)
    return content


def number_or_text(cell: str) -> float | str:
    """Return a cell as a number if possible, else as text."""
    try:
        return float(cell)
    except ValueError:
        return cell


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


def _check_system(row: ExperimentRow, system: str, report: Report) -> None:
    """Raise the faults of a row with a protocol or a channel that the system does not have."""
    protocols = system_class(system).protocols
    if row.protocol not in protocols:
        report.fault(
            f"system {system!r} has no model of protocol {row.protocol!r} (it has "
            f"{', '.join(protocols)}); correct or remove the row"
        )
    else:
        excitations, responses = channels_of(system, row.protocol)
        if row.excitation not in excitations:
            hint = nearest(row.excitation, excitations)
            report.fault(f"system {system!r} has no excitation {row.excitation!r}{hint}")
        if row.response not in responses:
            hint = nearest(row.response, responses)
            report.fault(f"system {system!r} has no response {row.response!r}{hint}")
    report.raise_faults()


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
