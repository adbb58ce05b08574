"""Tables of the report: rounded on the page, in full precision as CSV."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures.results import (
    AnalysisResults,
    CandidateResults,
    PopulationResults,
    StudyResults,
)
from deabayes.population.coordinate import OF_LOGARITHM
from deabayes.posteriors.sensitivity import in_words
from deabayes.prediction.errors import NARROW_COVERAGE, REJECTED
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

Rows = list[dict[str, Any]]

_PLAIN_UNITS = sorted((u for u in USUAL_UNITS if u.isalpha()), key=len, reverse=True)
_ONE_UNIT = "|".join(map(re.escape, _PLAIN_UNITS))
UNIT_AT_END = re.compile(rf"(?P<name>.+?)_(?P<unit>(?:(?:(?:{_ONE_UNIT})_)?per_)?(?:{_ONE_UNIT}))")
"""Column name of experiments.csv that ends in a unit: `bias_kV`, `crosshead_mm_per_min`."""
UNITS = {
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
} | {unit: unit for unit in "kV V mm m s ms Hz kPa Pa mW mN N kHz nF mA rad g".split()}
"""Unit for which the last word of a column's name stands."""
LOW, HIGH = "_q05", "_q95"
UNIFORM = 0.05
"""Smallest p-value of uniform PIT at which a record's points count as predicted."""
DIGITS = 4
"""Significant digits of a number without interval, as many as the papers print."""
LONGEST = 80
"""Most rows of a table on the page; longer tables are only in the report's tables folder."""
HAVE_IT = "you have it: move it to `calibrate`"
"""What is said of a record that is held out and would be a telling further experiment."""
KINDS = {
    "material": "Material",
    "specimen": "Specimen (measured, with uncertainty)",
    "derived": "Derived",
    "noise": "Noise model",
}


def write_csv(
    studies: Iterable[StudyResults], folder: Path, populations: Iterable[PopulationResults] = ()
) -> None:
    """Write the tables of studies and populations as CSV, in full precision and SI units.

    `{study}_{errors,summary,comparison,further_experiments}.csv` hold all candidates of a study.
    `{study}_{candidate}_predictions.csv` holds the points of its figures, with seven digits.
    `{study}_{table}.csv` holds a table of its analyses.
    `population_{name}_{summary,shrinkage}.csv` hold the tables of a population.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for study in studies:
        candidates = {c.name: c for c in study.candidates}
        summaries = {n: c.summary for n, c in candidates.items() if c.summary is not None}
        tables: dict[str, pd.DataFrame | None] = {
            "errors": _stacked(
                {n: c.errors for n, c in candidates.items() if c.errors is not None}
            ),
            "summary": _stacked({n: table.reset_index() for n, table in summaries.items()}),
            "comparison": None if study.comparison is None else study.comparison.reset_index(),
            "further_experiments": study.further_experiments,
        }
        tables |= {f"{n}_predictions": predictions(c) for n, c in candidates.items()}
        for analysis in study.analyses:
            tables |= analysis.tables
        for kind, table in tables.items():
            if table is not None:
                table = table.assign(provenance=study.provenance)
                digits = "%.7g" if kind.endswith("_predictions") else None
                table.to_csv(folder / f"{study.name}_{kind}.csv", index=False, float_format=digits)
    for population in populations:
        for kind, table in (
            ("summary", population.summary.reset_index()),
            ("shrinkage", population.shrinkage.drop(columns="provenance")),
        ):
            table = table.assign(provenance=population.provenance)
            table.to_csv(folder / f"population_{population.name}_{kind}.csv", index=False)


def predictions(results: CandidateResults) -> pd.DataFrame | None:
    """Every point of every record with its prediction and bands, in SI; None without records."""
    rows = [
        pd.DataFrame({
            "experiment": name,
            "role": p.attrs["role"],
            "coordinate": p["coordinate"].values,
            **{each: p[each].values for each in ("excitation", "observed", "median", "mean")},
            **{
                f"{band}_{100 * level:.0f}_{bound}": p[band].sel(level=level, bound=bound).values
                for band in ("parameter", "discrepancy", "predictive")
                for level in p["level"].values
                for bound in p["bound"].values
            },
        })
        for name, p in results.predictions.items()
    ]  # fmt: skip
    return pd.concat(rows, ignore_index=True) if rows else None


def _stacked(tables: Mapping[str, pd.DataFrame | None]) -> pd.DataFrame | None:
    """Join the candidates' tables, with the candidate as first column; None without a table."""
    present = [t.assign(candidate=name) for name, t in tables.items() if t is not None]
    if not present:
        return None
    joined = pd.concat(present, ignore_index=True)
    return joined[["candidate", *joined.columns.drop("candidate")]]


def records(study: StudyResults) -> Rows:
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


def parameters(results: CandidateResults) -> dict[str, Rows]:
    """Rows of the parameter table by kind: median [5 %, 95 %] in display units."""
    table = results.summary
    if table is None:
        return {}
    groups = {
        title: [parameter(results, n) for n in results.names(kind) if n in table.index]
        for kind, title in KINDS.items()
    }
    return {title: rows for title, rows in groups.items() if rows}


def parameter(results: CandidateResults, name: str) -> dict[str, Any]:
    """Row of a quantity of summary.csv; its prior is in the same unit as its value."""
    assert results.summary is not None
    row, label = results.summary.loc[name], results.label(name)
    unit = display_unit(label["unit"], row["median"], name)
    contraction = float(row["contraction"])
    return {
        "name": name,
        "symbol": symbol_html(label["symbol"]),
        "description": label["description"],
        "value": _interval(row, unit.factor),
        "unit": unit.label,
        "contraction": f"{fixed(100 * contraction, 0)} %" if np.isfinite(contraction) else "–",
        "sensitivities": _sensitivities(row),
        "decided_by": in_words(row),
        "r_hat": f"{row['r_hat']:.3f}",
        "ess": f"{row['ess_bulk']:.0f} / {row['ess_tail']:.0f}",
        "converged": bool(row["converged"]),
        "prior": _prior(results, name, unit.factor),
        "prior_law": law(label["prior"]),
    }


def _prior(results: CandidateResults, name: str, factor: float) -> str:
    """Median [5 %, 95 %] of the prior; a dash if the posterior file has no draws of it."""
    draws = results.prior[name].values if name in results.prior else np.empty(0)
    finite = draws[np.isfinite(draws)] / factor
    return interval(*np.quantile(finite, [0.5, 0.05, 0.95])) if finite.size else "–"


def law(described: str) -> str:
    """Name of a prior without its settings: ``log-normal`` of ``log-normal, median 35e3, ...``."""
    return re.split(r",? (?:a likelihood|misfit|multivariate|median|mean|lower|sd)\b", described)[0]


def _sensitivities(row: pd.Series) -> str:
    """Sensitivities to prior and likelihood as text; a dash if the table has no such columns."""
    columns = ("prior_sensitivity", "likelihood_sensitivity")
    if not set(columns) <= set(row.index):
        return "–"
    values = [float(row[column]) for column in columns]
    if not np.any(np.isfinite(values)):
        return "not known"
    return " / ".join(f"{v:.3f}" if np.isfinite(v) else "not known" for v in values)


def errors(results: CandidateResults) -> dict[str, Rows]:
    """Rows of the error table by role."""
    table = results.errors
    if table is None:
        return {}
    groups = {
        text: [_error(results, row) for _, row in table[table["role"] == role].iterrows()]
        for role, text in ROLES.items()
    }
    return {text: rows for text, rows in groups.items() if rows}


def _error(results: CandidateResults, row: pd.Series) -> dict[str, Any]:
    flag, p = row["extrapolation"], float(row.get("pit_p", np.nan))
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
        "pit": _as_predicted(p, row["coverage_90"]),
        "extrapolation": flag if isinstance(flag, str) else "",
        "flagged": isinstance(flag, str) or row["coverage_90"] < NARROW_COVERAGE or p < REJECTED,
    }


def _as_predicted(p: float, coverage: float) -> str:
    """Verdict on the p-value of uniform PIT, with the 5 % limit of the figure `pit`.

    Points are not as predicted either if the 90 % band misses the record.
    """
    if np.isnan(p):
        return ""
    shown = f"p = {fixed(p, 3)}" if p >= 0.0005 else "p < 0.001"
    good = p >= UNIFORM and not coverage < NARROW_COVERAGE
    return f"{'as predicted' if good else 'not as predicted'}, {shown}"


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{100 * share:.0f} %"


def comparison(study: StudyResults) -> Rows:
    """Rows of the table that compares model orders."""
    if study.comparison is None:
        return []
    return [
        {
            "candidate": name,
            "shown": name == study.recommended.name,
            "n_parameters": int(row["n_parameters"]),
            "log_evidence": _with_error(row["log_evidence"], row["log_evidence_mcse"]),
            "log_evidence_nested": _with_error(
                row.get("log_evidence_nested", np.nan), row.get("log_evidence_nested_error", np.nan)
            ),
            "bic": _with_error(row["bic"]),
            "elpd": _with_error(row["elpd_block_loo"], row["elpd_block_loo_se"]),
            "left_out": _with_error(row["elpd_leave_one_experiment_out"]),
            "k_hat": _with_error(row["worst_k_hat"], decimals=2),
            "converged": bool(row["converged"]),
            "verdict": row["verdict"],
        }
        for name, row in study.comparison.iterrows()
    ]


def has_nested(study: StudyResults) -> bool:
    """Whether nested sampling checked the evidence of at least one candidate."""
    table = study.comparison
    return table is not None and bool(table.get("log_evidence_nested", pd.Series()).notna().any())


def further_experiments(study: StudyResults) -> Rows:
    """Rows of the table of further experiments, the most informative first."""
    table = study.further_experiments
    if table is None:
        return []
    names = str(table["candidates"].iloc[0]).split(", ")
    return [
        {
            "experiment": row["experiment"],
            "what": row["what"],
            "probability": _with_error(row["probability_right"], row["probability_right_error"], 2),
            "candidate": _with_error(
                row["information_candidate_nats"], row["information_candidate_error_nats"], 2
            ),
            "parameters": [
                f"{name} {_with_error(row[f'information_{name}_nats'])}" for name in names
            ],
            "held_out": bool(row["held_out"]),
            "cautions": _cautions(row),
        }
        for _, row in table.iterrows()
    ]


def _cautions(row: pd.Series) -> list[str]:
    cautions = [HAVE_IT] if row["held_out"] else []
    cautions += [row["extrapolation"]] if isinstance(row["extrapolation"], str) else []
    if row["failed_share"] > 0.0 and not row["held_out"]:
        percent = f"{100 * row['failed_share']:.3g} %"
        cautions.append(
            f"{percent} of the draws have no response ({row['failure']}): the specimen may not "
            "survive it"
        )
    return cautions


def _with_error(value: float, error: float = np.nan, decimals: int = 1) -> str:
    """A number with its error if that is known; a dash if the number is not known."""
    if not np.isfinite(value):
        return "–"
    return fixed(value, decimals) + (f" ± {error:.{decimals}f}" if np.isfinite(error) else "")


def of_analysis(analysis: AnalysisResults) -> dict[str, dict[str, Any]]:
    """Return an analysis' readable tables by name, except those of more than `LONGEST` rows."""
    return {name: readable(t) for name, t in analysis.tables.items() if len(t) <= LONGEST}


def readable(table: pd.DataFrame) -> dict[str, Any]:
    """Join columns `x`, `x_q05`, `x_q95` as ``median [5 %, 95 %]`` and round the numbers."""
    bounds = {str(c) for c in table.columns if str(c).endswith((LOW, HIGH))}
    kept = [str(c) for c in table.columns if str(c) not in bounds and c != "converged"]
    cells = [_cells(table, name, bounds) for name in kept]
    converged = table["converged"] if "converged" in table else [True] * len(table)
    return {
        "header": [heading(name) for name in kept],
        "number": [table[name].dtype.kind in "if" for name in kept],
        "rows": [list(row) for row in zip(*cells, strict=True)],
        "converged": [bool(value) for value in converged],
    }


def heading(column: str) -> str:
    """Heading of a column: ``e_m_percent`` becomes ``e m (%)``."""
    name, unit = _split(column)
    return plain(name) + (f" ({unit})" if unit else "")


def _split(column: str) -> tuple[str, str]:
    name, _, last = column.rpartition("_")
    return (name, UNITS[last]) if name and last in UNITS else (column, "")


def _cells(table: pd.DataFrame, column: str, bounds: set[str]) -> list[str]:
    base = next((b for b in (column, _split(column)[0]) if b + LOW in bounds), None)
    if base is None:
        return [_text(value) for value in table[column]]
    rows = zip(table[column], table[base + LOW], table[base + HIGH], strict=True)
    # A value printed in a paper has no interval.
    return [interval(*row) if np.all(np.isfinite(row)) else _text(row[0]) for row in rows]


def _text(value: object) -> str:
    if isinstance(value, str):
        return ROLES.get(value, value)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    number = float(value)  # type: ignore[arg-type]
    return short(number, DIGITS) if np.isfinite(number) else "–"


def population_parameters(results: PopulationResults) -> Rows:
    """Rows of a population's parameters: mean, new specimen and spread."""
    return [_population_parameter(results, name) for name in results.parameters]


def _population_parameter(results: PopulationResults, name: str) -> dict[str, Any]:
    """Row of a parameter: new specimen, population mean and spread as median [5 %, 95 %]."""
    summary, label = results.summary, results.new_specimen.label(name)
    new, mean, spread = (summary.loc[prefix + name] for prefix in ("", "mean_", "spread_"))
    unit = display_unit(label["unit"], mean["median"], name)
    relative = OF_LOGARITHM in results.new_specimen.label(f"spread_{name}")["description"]
    return {
        "name": name,
        "symbol": symbol_html(label["symbol"]),
        "description": label["description"].removesuffix(", of a new specimen"),
        "unit": unit.label,
        "mean": _interval(mean, unit.factor),
        "new": _interval(new, unit.factor),
        "spread": _interval(spread, 0.01 if relative else unit.factor),
        "spread_unit": "%" if relative else unit.label,
    }


def specimens(results: PopulationResults) -> Rows:
    """Rows of every specimen's estimates, from its own records and with the population."""
    return [_specimen(row) for _, row in results.shrinkage.iterrows()]


def _specimen(row: pd.Series) -> dict[str, Any]:
    unit = display_unit(row["unit"], row["median"], row["parameter"])
    return {
        "study": row["study"],
        "symbol": symbol_html(row["symbol"]),
        "parameter": row["parameter"],
        "unit": unit.label,
        "own": _interval(row, unit.factor),
        "shrunken": _interval(row, unit.factor, "shrunken_"),
        "shrinkage": f"{100 * row['shrinkage']:.0f} %",
        "tail": f"{row['tail_probability']:.2g}",
        "k_hat": short(row["k_hat"], 2),
        "effective": f"{row['effective_draws']:.0f}",
        "sound": bool(row["reliable"] and row["converged"]),
    }


def _interval(row: pd.Series, factor: float, prefix: str = "") -> str:
    return interval(
        *(float(row[prefix + quantile]) / factor for quantile in ("median", "q05", "q95"))
    )
