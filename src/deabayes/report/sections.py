"""Sections of the report: analyses, further experiments, model orders, populations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deabayes.figures.noise_share import sizes
from deabayes.figures.results import PopulationResults, StudyResults
from deabayes.population.coordinate import OF_LOGARITHM
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
from deabayes.report.notices import Notice, extrapolation, failures, grouped

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
"""Unit for which the last word of a column's name stands."""
LOW, HIGH = "_q05", "_q95"
DIGITS = 4
"""Significant digits of a number without interval, as many as the papers print."""
HIDDEN = ("converged",)
LONGEST = 80
"""Most rows of a table on the page; longer tables are only in the report's tables folder."""


def analysis_tables(study: StudyResults, names: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """Return the readable tables of at most `LONGEST` rows, by analysis and table name."""
    return {
        each.name: {
            name: readable(table) for name, table in each.tables.items() if len(table) <= LONGEST
        }
        for each in study.analyses
        if not names or each.name in names
    }


def readable(table: pd.DataFrame) -> dict[str, Any]:
    """Join columns `x`, `x_q05`, `x_q95` as ``median [5 %, 95 %]`` and round the numbers."""
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
    ends = zip(table[column], table[base + LOW], table[base + HIGH], strict=True)
    # A value printed in a paper has no interval.
    return [interval(*each) if np.all(np.isfinite(each)) else _text(each[0]) for each in ends]


def _text(value: object) -> str:
    if isinstance(value, str):
        return ROLES.get(value, value)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    number = float(value)  # type: ignore[arg-type]
    return short(number, DIGITS) if np.isfinite(number) else "–"


SURE, MAY_FAIL = 0.9, 0.01
"""Probability of deciding rightly above which an experiment is said to decide, and share of draws
without a response above which an experiment is not proposed."""
ROUNDING = 0.005
"""Difference in nats that is ignored."""


def further_sentence(study: StudyResults) -> str:
    """Describe the best further experiment; empty unless there are several candidates."""
    table = study.further_experiments
    if table is None or ", " not in str(table["candidates"].iloc[0]):
        return ""
    names = str(table["candidates"].iloc[0]).split(", ")
    question = f"tell {names[0]} from {_either(names[1:])}"
    safe = table[table["failed_share"] <= MAY_FAIL]
    telling = safe[
        safe["information_candidate_nats"] > 2.0 * safe["information_candidate_error_nats"]
    ]
    if telling.empty:
        text = f"{_none_of(table)} be expected to {question}"
        return text + (", save some that the specimen may not survive." if _lost(table) else ".")
    best = _preferred(telling)
    probability = f"{best['probability_right']:.2f}"
    outside = best["extrapolation"]
    caution = f" It is an extrapolation ({outside})." if isinstance(outside, str) else ""
    if best["probability_right"] < SURE:
        return (
            f"{_none_of(table)} surely {question}; the best, "
            f"{_said(best)}, would decide rightly with probability {probability} "
            f"({1.0 / len(names):.2f} is guessing).{caution}"
        )
    return (
        f"{_sentence_case(_said(best))} would be expected to {question}, deciding rightly with "
        f"probability {probability}.{caution}"
    )


def further_rows(study: StudyResults) -> list[dict[str, Any]]:
    """Rows of the table of further experiments, the most informative first."""
    table = study.further_experiments
    if table is None:
        return []
    names = str(table["candidates"].iloc[0]).split(", ")
    return [
        {
            "experiment": row["experiment"],
            "what": row["what"] + (", held-out record" if row["held_out"] else ""),
            "probability": _number(row["probability_right"], row["probability_right_error"]),
            "candidate": _number(
                row["information_candidate_nats"], row["information_candidate_error_nats"]
            ),
            "parameters": [
                f"{name} {_number(row[f'information_{name}_nats'], np.nan, 1)}" for name in names
            ],
            "cautions": _cautions(row),
        }
        for _, row in table.iterrows()
    ]


def _preferred(telling: pd.DataFrame) -> pd.Series:
    """Choose among the experiments that are as informative as the best one, within errors.

    A held-out record comes first, because it is already measured, then an experiment inside the
    calibrated range.
    """
    nats, error = telling["information_candidate_nats"], telling["information_candidate_error_nats"]
    margin = np.maximum(2.0 * np.hypot(error, error.iloc[0]), ROUNDING)
    equal = telling[nats >= nats.iloc[0] - margin]
    outside = equal["extrapolation"].map(lambda flag: isinstance(flag, str) and bool(flag))
    order = equal.assign(new=~equal["held_out"].astype(bool), outside=outside)
    return equal.loc[order.sort_values(["new", "outside"], kind="stable").index[0]]


def _none_of(table: pd.DataFrame) -> str:
    several = f"None of the {len(table)} experiments considered would"
    return several if len(table) > 1 else "The only experiment considered would not"


def _lost(table: pd.DataFrame) -> bool:
    risky = table[table["failed_share"] > MAY_FAIL]
    errors = risky["information_candidate_error_nats"]
    return bool((risky["information_candidate_nats"] > 2.0 * errors).any())


def _cautions(row: pd.Series) -> list[str]:
    found = [row["extrapolation"]] if isinstance(row["extrapolation"], str) else []
    if row["failed_share"] > 0.0:
        percent = f"{100 * row['failed_share']:.3g} %"
        found.append(
            f"{percent} of the draws have no response ({row['failure']}): the specimen may not "
            "survive it"
        )
    return found


def _said(row: pd.Series) -> str:
    kind = "the held-out record " if row["held_out"] else ""
    return f"{kind}{row['experiment']} ({row['what']})"


def _sentence_case(text: str) -> str:
    return text.replace("the held-out", "The held-out", 1)


def _either(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _number(value: float, error: float, decimals: int = 2) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{value:.{decimals}f}" + (f" ± {error:.{decimals}f}" if np.isfinite(error) else "")


def order_rows(study: StudyResults) -> list[dict[str, Any]]:
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
            "bic": _fixed(row["bic"]),
            "elpd": _with_error(row["elpd_block_loo"], row["elpd_block_loo_se"]),
            "left_out": _fixed(row["elpd_leave_one_experiment_out"]),
            "k_hat": _fixed(row["worst_k_hat"], 2),
            "converged": bool(row["converged"]),
            "verdict": row["verdict"],
        }
        for name, row in study.comparison.iterrows()
    ]


def asked_for_nested(study: StudyResults) -> bool:
    """Whether nested sampling checked the evidence of at least one candidate."""
    table = study.comparison
    return table is not None and bool(table.get("log_evidence_nested", pd.Series()).notna().any())


def may_hide(study: StudyResults) -> str:
    """State how large a further unit may be and still be hidden in correlated noise.

    Empty if nothing is compared, or if correlated noise is nowhere larger than white noise.
    """
    if study.comparison is None or len(study.comparison) < 2:
        return ""
    found = sizes(study.recommended)
    above = {
        name: each["correlated"]
        for name, each in found.items()
        if each.get("correlated", 0.0) > each.get("white", 0.0)
    }
    if not above:
        return ""
    name = max(above, key=lambda record: above[record])
    white = found[name].get("white", 0.0)
    beside = f", beside white noise of {significant(100 * white, 2)} %" if white else ""
    most = ", the most of its records" if len(found) > 1 else ""
    return (
        f"Correlated noise takes what {study.recommended.name} leaves: "
        f"{significant(100 * above[name], 2)} % of the range in {name}{most}{beside}. A further "
        "unit that adds less than that may be hidden in it. The verdict says which units these "
        "records need, not that there are no others."
    )


def _fixed(value: float, decimals: int = 1) -> str:
    return fixed(value, decimals) if np.isfinite(value) else "–"


def _with_error(value: float, error: float) -> str:
    return _fixed(value) + (f" ± {error:.1f}" if np.isfinite(error) and np.isfinite(value) else "")


FIGURES = ("shrinkage", "new_specimen")


def population_section(results: PopulationResults) -> dict[str, Any]:
    """Content of a population's section, without its figures."""
    return {
        "name": results.name,
        "candidate": results.attributes["candidate"],
        "system": results.system,
        "provenance": results.provenance,
        "converged": results.converged,
        "members": results.members,
        "parameters": [_parameter(results, name) for name in results.parameters],
        "specimens": list(specimens(results)),
    }


def _parameter(results: PopulationResults, name: str) -> dict[str, Any]:
    """Row of a parameter: new specimen, population mean and spread as median [5 %, 95 %]."""
    summary, label = results.summary, results.new_specimen.label(name)
    new, mean, spread = (summary.loc[p + name] for p in ("", "mean_", "spread_"))
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


def specimens(results: PopulationResults) -> Iterator[dict[str, Any]]:
    """Yield the estimates of every specimen, from its own records and with the population."""
    for _, row in results.shrinkage.iterrows():
        unit = display_unit(row["unit"], row["median"], row["parameter"])
        yield {
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


def population_notices(results: PopulationResults) -> Iterator[Notice]:
    """Notices of a population: what a reader must know before trusting its numbers."""
    where = results.name, str(results.attributes["candidate"])
    if not results.converged:
        reasons = tuple(grouped(results.new_specimen.convergence, {}))
        yield Notice(*where, "Population not converged: do not use these numbers", reasons)
    for check in (extrapolation, failures):
        for notice in check(results.new_specimen):
            yield replace(notice, study=where[0], candidate=where[1])
    warnings = tuple(str(each) for each in results.attributes.get("warnings") or ())
    if warnings:
        yield Notice(*where, "Specimens and their population", warnings)


def write_csv(populations: Iterable[PopulationResults], folder: Path) -> None:
    """Write `population_{name}_{summary,shrinkage}.csv` in full precision and SI units."""
    for each in populations:
        tables: dict[str, pd.DataFrame] = {
            "summary": each.summary.reset_index(),
            "shrinkage": each.shrinkage.drop(columns="provenance"),
        }
        for kind, table in tables.items():
            path = folder / f"population_{each.name}_{kind}.csv"
            table.assign(provenance=each.provenance).to_csv(path, index=False)


def _interval(row: pd.Series, factor: float, prefix: str = "") -> str:
    return interval(*(row[prefix + quantile] / factor for quantile in ("median", "q05", "q95")))
