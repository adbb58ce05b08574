"""Which rows of experiments.csv a study uses, and in which role."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from deabayes.experiment import Role
from deabayes.faults import UserError, nearest
from deabayes.reading.raw import ExperimentRow
from deabayes.reading.table import FILE, number_or_text, read_table


def told_apart_by(row: ExperimentRow) -> dict[str, float | str]:
    """Columns that `select` and `split_by` know -> the row's values."""
    named = {"protocol": row.protocol, "excitation": row.excitation, "response": row.response}
    return {**named, **row.metadata}


def values_of(folder: Path, column: str) -> list[str]:
    """The distinct values of a column, in order of appearance (for `split_by`)."""
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
    """The rows whose columns have the wanted values, numbers by value (for `select`)."""
    return [
        row
        for row in rows
        if all(
            told_apart_by(row).get(column) in (value, number_or_text(value))
            for column, value in wanted.items()
        )
    ]


def none_to_fit(folder: Path, calibrate: object, validate: object) -> str:
    """What to say where no row is calibrated on, by the two lists of a study."""
    todo = "give one the role `calibrate` in experiments.csv"
    if calibrate is not None or validate:
        todo = "name one of its records under `calibrate`, and not under `validate`"
    return f"no record to calibrate on in {folder}; {todo}"


def in_roles(
    rows: Iterable[ExperimentRow],
    calibrate: Collection[str] | None,
    validate: Collection[str] | None,
) -> list[ExperimentRow]:
    """The rows to calibrate on, then those held out, each in the role that a study gives it.

    A name that is listed has the role of its list. Where a role has no list (None), it has the
    rows that the role column gives to it and the other role's list does not name.
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
