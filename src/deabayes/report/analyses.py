"""The section on what the paper of a system reports: an analysis' tables, made readable."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES, interval, plain, short

UNITS = {
    **{
        "percent": "%",
        "percentperV": "%/V",
        "um": "µm",
        "kVmm": "kV·mm",
        "ohm": "Ω",
        "Gohm": "GΩ",
        "kgm": "kg/m",
        "Nperm": "N/m",
        "Nsperm": "N·s/m",
        "mNmperrad": "mN·m/rad",
    },
    **{unit: unit for unit in "kV V mm m s ms Hz kPa Pa mW mN N kHz nF mA rad g".split()},
}
"""Last word of a column's name -> the unit it stands for."""
LOW, HIGH = "_q05", "_q95"
DIGITS = 4
"""Of a number without interval: as many as the papers print."""
HIDDEN = ("converged",)
LONGEST = 80
"""Rows of a table shown; longer ones are in the report's tables folder only."""


def tables(study: StudyResults, names: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """Table -> header, rows and which of them are of unconverged candidates, by analysis."""
    return {
        each.name: {
            name: readable(table) for name, table in each.tables.items() if len(table) <= LONGEST
        }
        for each in study.analyses
        if not names or each.name in names
    }


def readable(table: pd.DataFrame) -> dict[str, Any]:
    """Columns `x`, `x_q05`, `x_q95` as one ``median [5 %, 95 %]``; numbers rounded."""
    bounds = {str(c) for c in table.columns if str(c).endswith((LOW, HIGH))}
    kept = [str(c) for c in table.columns if str(c) not in bounds and c not in HIDDEN]
    cells = {name: _cells(table, name, bounds) for name in kept}
    converged = table["converged"] if "converged" in table else [True] * len(table)
    return {
        "header": [heading(name) for name in kept],
        "number": [table[name].dtype.kind in "if" for name in kept],
        "rows": [list(row) for row in zip(*cells.values(), strict=True)],
        "converged": [bool(each) for each in converged],
    }


def heading(column: str) -> str:
    """``e_m_percent`` -> ``e m (%)``."""
    name, unit = _split(column)
    return plain(name) + (f" ({unit})" if unit else "")


def _split(column: str) -> tuple[str, str]:
    name, _, last = column.rpartition("_")
    return (name, UNITS[last]) if name and last in UNITS else (column, "")


def _cells(table: pd.DataFrame, column: str, bounds: set[str]) -> list[str]:
    base = next((b for b in (column, _split(column)[0]) if b + LOW in bounds), None)
    if base is None:
        return [_text(value) for value in table[column]]
    ends = zip(table[column], table[base + LOW], table[base + HIGH], strict=True)
    # A printed figure among posteriors has no interval.
    return [interval(*each) if np.all(np.isfinite(each)) else _text(each[0]) for each in ends]


def _text(value: object) -> str:
    if isinstance(value, str):
        return ROLES.get(value, value)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    number = float(value)  # type: ignore[arg-type]
    return short(number, DIGITS) if np.isfinite(number) else "–"
