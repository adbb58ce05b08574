"""The section on a population: its mean and spread, its specimens, a new one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from deabayes.figures.population_results import PopulationResults
from deabayes.population.coordinate import OF_LOGARITHM
from deabayes.quantities import display_unit, interval, short, symbol_html
from deabayes.report.notices import Notice, extrapolation, failures
from deabayes.report.reasons import grouped

FIGURES = ("shrinkage", "new_specimen")


def section(results: PopulationResults) -> dict[str, Any]:
    """What the page says of a population, its figures apart."""
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
    """A new specimen's value, the population's mean and its spread: median [5 %, 95 %]."""
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
    """Every specimen's estimate of every parameter, by itself and with the population."""
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


def notices(results: PopulationResults) -> Iterator[Notice]:
    """What a reader must know before trusting the numbers."""
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
    """`population_{name}_{summary,shrinkage}.csv`: full precision, SI."""
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
