"""Tables of the report: rounded on the page, in full precision as CSV."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.posteriors.sensitivity import in_words
from deabayes.quantities import (
    ROLES,
    display_unit,
    fixed,
    interval,
    plain,
    short,
    significant,
    symbol_html,
)
from deabayes.units import USUAL_UNITS

_PLAIN_UNITS = sorted((u for u in USUAL_UNITS if u.isalpha()), key=len, reverse=True)
_ONE_UNIT = "|".join(map(re.escape, _PLAIN_UNITS))
UNIT_AT_END = re.compile(rf"(?P<name>.+?)_(?P<unit>(?:(?:(?:{_ONE_UNIT})_)?per_)?(?:{_ONE_UNIT}))")
"""Column name of experiments.csv that ends in a unit: `bias_kV`, `crosshead_mm_per_min`."""

UNIFORM = 0.05
"""Smallest p-value of uniform PIT at which a record's points count as predicted."""
KINDS = {
    "material": "Material",
    "specimen": "Specimen (measured, with uncertainty)",
    "derived": "Derived",
    "noise": "Noise model",
}


def write_csv(studies: Iterable[StudyResults], folder: Path) -> list[Path]:
    """Write the tables of each study as CSV, in full precision and SI units.

    `{study}_{errors,summary,comparison,further_experiments}.csv` hold all candidates of a study.
    `{study}_{table}.csv` holds a table of its analyses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for study in studies:
        tables = {
            "errors": _stacked({c.name: c.errors for c in study.candidates}),
            "summary": _stacked(
                {c.name: None if c.summary is None else c.summary.reset_index()
                 for c in study.candidates}
            ),
            "comparison": None if study.comparison is None else study.comparison.reset_index(),
            "further_experiments": study.further_experiments,
        }  # fmt: skip
        for analysis in study.analyses:
            tables |= analysis.tables
        for kind, table in tables.items():
            if table is not None:
                path = folder / f"{study.name}_{kind}.csv"
                table.assign(provenance=study.provenance).to_csv(path, index=False)
                written.append(path)
    return written


def _stacked(tables: Mapping[str, pd.DataFrame | None]) -> pd.DataFrame | None:
    present = [t.assign(candidate=name) for name, t in tables.items() if t is not None]
    if not present:
        return None
    joined = pd.concat(present, ignore_index=True)
    return joined[["candidate", *joined.columns.drop("candidate")]]


def records(study: StudyResults) -> list[dict[str, Any]]:
    """Rows of the records table, one per prepared record."""
    return [_record(experiment) for experiment in study.experiments.values()]


def _record(e: Experiment) -> dict[str, Any]:
    excitation = e.excitation
    steps = [str(s.get("step", s.get("name", next(iter(s), "")))) for s in e.steps]
    return {
        "name": e.name,
        "role": ROLES[e.role],
        "protocol": plain(e.protocol),
        "excitation": _range(excitation.values, excitation.unit, excitation.name),
        "response": _range(e.response, e.response_unit, e.response_name),
        "coordinate": _range(e.coordinate, e.coordinate_unit, e.coordinate_name),
        "points": str(e.coordinate.size),
        "metadata": about(e.metadata),
        "steps": ", ".join(plain(step) for step in steps if step),
        "provenance": e.provenance,
    }


def about(metadata: Mapping[str, float | str]) -> str:
    """Text of the metadata of a record in experiments.csv, with the note last.

    The unit follows the number: `load_g` of 100 becomes "load 100 g".
    """
    stated = [_stated(name, value) for name, value in metadata.items() if name != "note"]
    return "; ".join(text for text in [*stated, str(metadata.get("note", ""))] if text)


def _stated(name: str, value: float | str) -> str:
    if not isinstance(value, float):
        return f"{plain(name)} {value}" if str(value) else ""
    if not np.isfinite(value):
        return ""
    split = UNIT_AT_END.fullmatch(name)
    if split is None:
        return f"{plain(name)} {short(value)}"
    unit, _, per = split["unit"].rpartition("per_")
    unit = f"{unit.strip('_') or '1'}/{per}" if split["unit"] != per else per
    return f"{plain(split['name'])} {short(value)} {unit}"


def _range(values: FloatArray, unit: str, name: str) -> tuple[str, str]:
    """Name of a channel, and its lowest and highest value in a display unit."""
    display = display_unit(unit, values, name)
    low, high = float(np.min(values)) / display.factor, float(np.max(values)) / display.factor
    low, high = (0.0 if abs(end) < 1e-3 * (high - low) else end for end in (low, high))
    text = short(low) if low == high else f"{short(low)} – {short(high)}"
    return plain(name), f"{text} {display.label}".strip()


def parameters(results: CandidateResults) -> dict[str, list[dict[str, Any]]]:
    """Rows of the parameter table by kind: median [5 %, 95 %] in display units."""
    table = results.summary
    if table is None:
        return {}
    groups = {
        title: [
            _parameter(results, n, table.loc[n]) for n in results.names(kind) if n in table.index
        ]
        for kind, title in KINDS.items()
    }
    return {title: rows for title, rows in groups.items() if rows}


def _parameter(results: CandidateResults, name: str, row: pd.Series) -> dict[str, Any]:
    label = results.label(name)
    unit = display_unit(label["unit"], row["median"], name)
    numbers = (float(row[key]) / unit.factor for key in ("median", "q05", "q95"))
    contraction = float(row["contraction"])
    return {
        "name": name,
        "symbol": symbol_html(label["symbol"]),
        "description": label["description"],
        "value": interval(*numbers),
        "unit": unit.label,
        "contraction": f"{fixed(100 * contraction, 0)} %" if np.isfinite(contraction) else "–",
        "sensitivities": _sensitivities(row),
        "decided_by": in_words(row),
        "r_hat": f"{row['r_hat']:.3f}",
        "ess": f"{row['ess_bulk']:.0f} / {row['ess_tail']:.0f}",
        "converged": bool(row["converged"]),
        "prior": label["prior"],
    }


def _sensitivities(row: pd.Series) -> str:
    """Sensitivities to prior and likelihood as text; a dash if the table has no such columns."""
    columns = ("prior_sensitivity", "likelihood_sensitivity")
    if not set(columns) <= set(row.index):
        return "–"
    values = [float(row[column]) for column in columns]
    if not np.any(np.isfinite(values)):
        return "not known"
    return " / ".join(f"{v:.3f}" if np.isfinite(v) else "not known" for v in values)


def errors(results: CandidateResults) -> dict[str, list[dict[str, Any]]]:
    """Rows of the error table by role."""
    table = results.errors
    if table is None:
        return {}
    groups = {text: table[table["role"] == role] for role, text in ROLES.items()}
    return {
        text: [_error(results, row) for _, row in rows.iterrows()]
        for text, rows in groups.items()
        if len(rows)
    }


def _error(results: CandidateResults, row: pd.Series) -> dict[str, Any]:
    flag = row["extrapolation"]
    attributes = results.predictions[row["experiment"]].attrs
    crps = display_unit(attributes["response_unit"], row["crps"], attributes["response_name"])
    return {
        "experiment": row["experiment"],
        "protocol": plain(str(row["protocol"])),
        "e_rms": interval(row["e_rms_percent"], row["e_rms_q05"], row["e_rms_q95"]),
        "e_m": interval(row["e_m_percent"], row["e_m_q05"], row["e_m_q95"]),
        "coverage_50": _percent(row["coverage_50"]),
        "coverage_90": _percent(row["coverage_90"]),
        "crps": ""
        if np.isnan(row["crps"])
        else f"{significant(row['crps'] / crps.factor)} {crps.label}".strip(),
        "pit": _uniform(float(row.get("pit_p", np.nan))),
        "extrapolation": flag if isinstance(flag, str) else "",
    }


def _uniform(p: float) -> str:
    """Verdict on the p-value of uniform PIT, with the 5 % limit of the figure `pit`."""
    if np.isnan(p):
        return ""
    shown = f"p = {fixed(p, 3)}" if p >= 0.0005 else "p < 0.001"
    return f"{'as predicted' if p >= UNIFORM else 'not as predicted'}, {shown}"


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{100 * share:.0f} %"
