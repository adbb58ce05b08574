"""Rows of experiments.csv that hold what another row holds, or have its name."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence

from deabayes.experiment import FloatArray
from deabayes.reading.measured import measured_rows
from deabayes.reading.raw import ExperimentRow, RawRecord


def repeated_records(records: Iterable[tuple[ExperimentRow, RawRecord]], where: str) -> list[str]:
    """Records with the values of another one, unless neither is fitted; a fault per row.

    The phase that a gain brings with it is a record, too.
    """
    every = [
        (row, each, raw.columns[each.response])
        for row, raw in records
        for each in measured_rows(row, raw)
        if each.response in raw.columns
    ]
    every.sort(key=lambda found: (found[0] is found[1], found[1].role != "calibrate"))
    seen: dict[str, tuple[ExperimentRow, ExperimentRow]] = {}
    faults: dict[str, str] = {}
    for row, each, values in every:
        gain, first = seen.setdefault(_digest(values), (row, each))
        fitted = "calibrate" in (first.role, each.role)
        if first.name != each.name and fitted:  # a row given twice is said elsewhere
            brought = first is not gain and each is row
            said = _brought(each, first, gain) if brought else _same(each, first)
            faults[row.name] = f"{where}: {said}"
    return list(faults.values())


def taken_names(records: Sequence[tuple[ExperimentRow, RawRecord]], where: str) -> list[str]:
    """Rows named as the phase that a gain brings with it."""
    own = {row.name.lower(): row.name for row, _ in records}
    return [
        f"{where}: row {own[phase.name.lower()]!r} has the name of the phase that row {row.name!r} "
        "brings with its gain; rename it, or remove it if it is that phase"
        for row, raw in records
        for phase in measured_rows(row, raw)[1:]
        if phase.name.lower() in own
    ]


def _digest(values: FloatArray) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()


def _same(row: ExperimentRow, first: ExperimentRow) -> str:
    twice = ", and would count twice" if row.role == first.role else ""
    return (
        f"{row.role} record {row.name!r} holds the same values as {first.role} record "
        f"{first.name!r}{twice}; give it another measurement, or remove the row"
    )


def _brought(row: ExperimentRow, phase: ExperimentRow, gain: ExperimentRow) -> str:
    return (
        f"{row.role} record {row.name!r} is the phase that {gain.role} record {gain.name!r} "
        f"brings with its gain, as {phase.name!r}; remove the row {row.name!r}"
    )
