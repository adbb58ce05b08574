"""Input and output of an analysis, and helpers for columns with intervals."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
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

Row = dict[str, object]
QUANTILES = (0.05, 0.95)
FIRST_COLUMNS = ("candidate", "order", "converged", "frequency_Hz")


@dataclass(frozen=True)
class Analysis:
    """Tables and curves of an analysis, by name; columns and variables carry their units.

    Table names are unique among all analyses of a study, because the report writes
    `{study}_{table}.csv`.
    """

    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    curves: Mapping[str, xr.Dataset] = field(default_factory=dict)

    @classmethod
    def of_rows(
        cls,
        tables: Mapping[str, Sequence[Mapping[str, object]]],
        curves: Mapping[str, xr.Dataset] | None = None,
    ) -> Analysis:
        """Return an analysis whose tables are given as rows; a table without rows is left out."""
        import pandas as pd

        return cls({name: pd.DataFrame(r) for name, r in tables.items() if r}, curves or {})

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

    def predicted(
        self, records: Sequence[Experiment]
    ) -> Iterator[tuple[Row, Experiment, FloatArray]]:
        """Yield first columns, record and responses (S, N) for every candidate and record."""
        for name, fitted in self.candidates.items():
            for record in records:
                yield labels(name, fitted), record, self.responses(name, record)


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
    finite = np.asarray(draws, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = np.quantile(finite, QUANTILES) if finite.size else (np.nan, np.nan)
    if value is None:
        value = float(np.median(finite)) if finite.size else np.nan
    column = f"{name}_{unit}" if unit else name
    return {column: float(value), f"{name}_q05": float(low), f"{name}_q95": float(high)}


def error_interval(
    name: str, curves: FloatArray, error: Callable[[FloatArray], FloatArray]
) -> dict[str, float]:
    """Return the columns of an error in percent: of the median curve, and of the draws' own.

    Parameters
    ----------
    curves : curves (S, N), one per draw.
    error : function from curves (..., N) to their errors (...) in percent.
    """
    return interval(name, "percent", error(curves), float(error(np.median(curves, axis=0))))


def band(draws: FloatArray) -> FloatArray:
    """Lower bound, median and upper bound (3, N) of draws (S, N)."""
    return np.quantile(draws, [QUANTILES[0], 0.5, QUANTILES[1]], axis=0)


def bands(
    context: StudyContext,
    experiment: Experiment,
    change: Callable[[FloatArray], FloatArray] = np.asarray,
) -> FloatArray:
    """Bands (candidate, bound, ...) of each candidate's responses (S, N) after `change`."""
    return np.array([band(change(context.responses(c, experiment))) for c in context.candidates])


def curve_set(
    context: StudyContext,
    coordinates: Mapping[str, tuple[ArrayLike, str]],
    variables: Mapping[str, tuple[ArrayLike, str]],
    record: Experiment | None = None,
    **attributes: object,
) -> xr.Dataset:
    """Data set of curves along coordinates, each given as values and unit.

    The dimensions of a variable are those of the coordinates, preceded by `candidate` if it has
    one more, and by (`candidate`, `bound`) if it has two more. Name and role of a `record` become
    attributes.
    """
    import xarray as xr

    along, fitted = tuple(coordinates), context.candidates
    content: dict[str, tuple[object, ...]] = {}
    for name, (values, unit) in variables.items():
        before = ("candidate", "bound")[: np.ndim(values) - len(along)]
        content[name] = ((*before, *along), np.asarray(values), {"units": unit})
    axes: dict[str, object] = {
        "candidate": list(fitted),
        "converged": ("candidate", [int(each.converged) for each in fitted.values()]),
        "bound": ["lower", "median", "upper"],
    }
    axes |= {name: (name, values, {"units": unit}) for name, (values, unit) in coordinates.items()}
    named = {} if record is None else {"experiment": record.name, "role": record.role}
    return xr.Dataset(content, axes, named | attributes)


def labels(name: str, fitted: Fitted) -> Row:
    """First columns of a candidate's row: name, order and convergence."""
    return {"candidate": name, "order": fitted.system.order, "converged": fitted.converged}


def beside(rows: Sequence[Row]) -> list[Row]:
    """Join the rows of a candidate at one frequency, with the voltage in the column names.

    The voltage is that of the column `voltage_kV`. `x_mm` at 5 kV becomes `x_5kV_mm`, and
    `x_q05` becomes `x_5kV_q05`. The lowest frequency and the highest voltage come first. If a
    voltage is repeated at a frequency, the repetition gets its own row below, in the given order.
    """
    candidates = list(dict.fromkeys(row["candidate"] for row in rows))

    def place(row: Row) -> tuple[float, ...]:
        frequency, volts = (float(str(row[name])) for name in ("frequency_Hz", "voltage_kV"))
        return candidates.index(row["candidate"]), frequency, -volts

    joined: dict[tuple[object, ...], Row] = {}
    repetitions: Counter[tuple[object, ...]] = Counter()
    for row in sorted(rows, key=place):
        first = {name: row[name] for name in FIRST_COLUMNS}
        voltage = f"{float(str(row['voltage_kV'])):.3g}kV"
        key = tuple(first.values())
        repetitions[*key, voltage] += 1
        line = joined.setdefault((*key, repetitions[*key, voltage]), first)
        for column, value in row.items():
            if column not in (*FIRST_COLUMNS, "voltage_kV"):
                name, _, last = column.rpartition("_")
                line[f"{name}_{voltage}_{last}" if name else f"{column}_{voltage}"] = value
    return list(joined.values())
