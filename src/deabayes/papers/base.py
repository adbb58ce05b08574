"""Input and output of an analysis, and helpers for columns with intervals."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.posteriors.fitted import Fitted
from deabayes.prior.joint import Prior, PriorFromPosterior
from deabayes.study import Study
from deabayes.systems.base import System

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class Analysis:
    """Tables and curves of an analysis, by name; columns and variables carry their units.

    Table names are unique among all analyses of a study, because the report writes
    `{study}_{table}.csv`.
    """

    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    curves: Mapping[str, xr.Dataset] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write `{table}.csv` and `{curve}.nc` into a folder."""
        from deabayes.files import write_atomically
        from deabayes.posteriors.storage import write_dataset

        folder.mkdir(parents=True, exist_ok=True)
        for name, table in self.tables.items():
            write_atomically(partial(table.to_csv, index=False), folder / f"{name}.csv")
        for name, curve in self.curves.items():
            write_dataset(curve, folder / f"{name}.nc")


@dataclass(frozen=True)
class StudyContext:
    """A fitted study, the input of the analyses.

    Attributes
    ----------
    experiments : the prepared records, with the roles the study gives them.
    candidates : fitted candidates by name, in the study's order, with a few hundred draws.
    inherited : the prior that the study takes from another study's posterior.
    """

    study: Study
    specimen: Specimen
    experiments: list[Experiment]
    candidates: Mapping[str, Fitted]
    inherited: PriorFromPosterior | None = None
    _responses: dict[tuple[str, str], FloatArray] = field(default_factory=dict, repr=False)

    def system_of(self, candidate: str) -> System:
        """Return the forward model of a candidate."""
        return self.candidates[candidate].system

    def prior_of(self, candidate: str) -> Prior:
        """Return the prior that a candidate was fitted with, including noise parameters."""
        from deabayes.inference.log_posterior import build

        target = build(self.study, candidate, self.specimen, self.experiments, self.inherited)
        return target.prior

    def rng(self, name: str) -> np.random.Generator:
        """Return a random generator with its own stream per (seed, study, analysis)."""
        words = [zlib.crc32(text.encode()) for text in (self.study.name, "analysis", name)]
        return np.random.default_rng([self.study.sampling.seed, *words])

    def responses(self, candidate: str, experiment: Experiment) -> FloatArray:
        """Return the model's responses (S, N) to a record, one row per draw with a finite response.

        If no draw has a finite response, the result is one row of NaN.
        """
        key = candidate, experiment.name
        if key not in self._responses:
            curves = self.candidates[candidate].responses(experiment)
            finite = curves[np.all(np.isfinite(curves), axis=1)]
            self._responses[key] = finite if len(finite) else np.full((1, curves.shape[1]), np.nan)
        return self._responses[key]

    def records(self, response: str, *protocols: str) -> list[Experiment]:
        """Return the records of a response that have any of these protocols."""
        return [
            each
            for each in self.experiments
            if each.protocol in protocols and each.response_name == response
        ]


QUANTILES = (0.05, 0.95)


def interval(
    name: str, unit: str, draws: ArrayLike, value: float | None = None
) -> dict[str, float]:
    """Return the columns `{name}_{unit}`, `{name}_q05`, `{name}_q95` of draws (S,).

    Parameters
    ----------
    unit : last word of the column name; empty for a number without unit.
    value : value of the first column, by default the median of the draws.

    Draws that are not finite are left out.
    """
    found = np.asarray(draws, dtype=float)
    found = found[np.isfinite(found)]
    low, high = np.quantile(found, QUANTILES) if found.size else (np.nan, np.nan)
    if value is None:
        value = float(np.median(found)) if found.size else np.nan
    column = f"{name}_{unit}" if unit else name
    return {column: float(value), f"{name}_q05": float(low), f"{name}_q95": float(high)}


def band(draws: FloatArray) -> FloatArray:
    """Lower bound, median and upper bound (3, N) of draws (S, N)."""
    return np.quantile(draws, [QUANTILES[0], 0.5, QUANTILES[1]], axis=0)


def labels(name: str, fitted: Fitted) -> dict[str, object]:
    """First columns of a candidate's row: name, order and convergence."""
    return {"candidate": name, "order": fitted.system.order, "converged": fitted.converged}


def beside(rows: Sequence[Mapping[str, object]], unit: str = "kV") -> list[dict[str, object]]:
    """Join the rows of a candidate at one frequency, with the voltage in the column names.

    The voltage is that of the column `voltage_{unit}`. `x_mm` at 5 kV becomes `x_5kV_mm`, and
    `x_q05` becomes `x_5kV_q05`. The lowest frequency and the highest voltage come first. If a
    voltage is repeated at a frequency, the repetition gets its own row below, in the given order.
    """
    same = ("candidate", "order", "converged", "frequency_Hz")
    voltage = f"voltage_{unit}"
    candidates = list(dict.fromkeys(row["candidate"] for row in rows))

    def place(row: Mapping[str, object]) -> tuple[float, ...]:
        frequency, volts = float(str(row["frequency_Hz"])), float(str(row[voltage]))
        return candidates.index(row["candidate"]), frequency, -volts

    joined: dict[tuple[object, ...], dict[str, object]] = {}
    times: Counter[tuple[object, ...]] = Counter()
    for row in sorted(rows, key=place):
        key = tuple(row[name] for name in same)
        told = f"{float(str(row[voltage])):.3g}{unit}"
        times[*key, told] += 1
        one = joined.setdefault((*key, times[*key, told]), dict(zip(same, key, strict=True)))
        one |= {
            _told(column, told): value
            for column, value in row.items()
            if column not in (*same, voltage)
        }
    return list(joined.values())


def _told(column: str, told: str) -> str:
    name, _, last = column.rpartition("_")
    return f"{name}_{told}_{last}" if name else f"{column}_{told}"
