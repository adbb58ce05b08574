"""Results files of studies, populations and analyses, read when they are needed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deabayes.comparison.verdicts import CHOSEN
from deabayes.faults import UserError
from deabayes.posteriors.storage import fitted_posteriors

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from deabayes.experiment import Experiment, FloatArray
    from deabayes.noise.base import NoiseModel
SETTINGS = "population.yaml"
PREVIEW = "preview"
"""Folder of a study's preview, from which no other figure is drawn."""


@dataclass(frozen=True)
class AnalysisResults:
    """One analysis in `results/{study}/analyses/{name}`: title, caption, tables and curves."""

    folder: Path
    title: str
    caption: str
    table_names: tuple[str, ...]
    curve_names: tuple[str, ...]

    @classmethod
    def of(cls, folder: Path, entry: Mapping[str, Any]) -> AnalysisResults:
        """Build the results from an entry of index.json."""
        names = (tuple(entry[kind]) for kind in ("tables", "curves"))
        return cls(folder / entry["name"], entry["title"], entry["caption"], *names)

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def is_empty(self) -> bool:
        return not (self.table_names or self.curve_names)

    @cached_property
    def tables(self) -> Mapping[str, pd.DataFrame]:
        import pandas as pd

        return {name: pd.read_csv(self.folder / f"{name}.csv") for name in self.table_names}

    @cached_property
    def curves(self) -> Mapping[str, xr.Dataset]:
        import xarray as xr

        files = {name: self.folder / f"{name}.nc" for name in self.curve_names}
        return {name: xr.load_dataset(file, engine="h5netcdf") for name, file in files.items()}


@dataclass(frozen=True)
class StudyResults:
    """One study in `results/{study}`: prepared records, fitted candidates and their comparison."""

    folder: Path

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    @property
    def study(self) -> StudyResults:
        """This object itself, so that all results have the attribute `study`."""
        return self

    @cached_property
    def candidates(self) -> tuple[CandidateResults, ...]:
        """Fitted candidates of the study, fewest parameters first."""
        candidates = [
            CandidateResults(self, path.parent) for path in fitted_posteriors(self.folder)
        ]
        if not candidates:
            raise UserError(
                f"{self.folder}: holds no fitted candidate (*/posterior.nc); "
                "run `snakemake --cores 2` or `deabayes fit` first"
            )
        return tuple(sorted(candidates, key=lambda c: (len(c.sampled), c.name)))

    @cached_property
    def comparison(self) -> pd.DataFrame | None:
        """Table comparison.csv indexed by candidate; None if there is no such file."""
        table = _table(self.folder / "comparison.csv")
        return None if table is None else table.set_index("candidate")

    @cached_property
    def further_experiments(self) -> pd.DataFrame | None:
        """Table further_experiments.csv, most informative first; None if it is missing or empty."""
        table = _table(self.folder / "further_experiments.csv")
        return None if table is None or table.empty else table

    @cached_property
    def recommended(self) -> CandidateResults:
        """Candidate that the comparison selects; else the first converged one, else the first."""
        by_name = {c.name: c for c in self.candidates}
        if self.comparison is not None:
            shown = self.comparison["verdict"].astype(str).str.contains(CHOSEN)
            for name in self.comparison.index[shown].astype(str):
                if name in by_name:
                    return by_name[name]
        return next((c for c in self.candidates if c.converged), self.candidates[0])

    @cached_property
    def experiments(self) -> Mapping[str, Experiment]:
        """The prepared records by name, calibration records first, with warnings of idle masks."""
        from deabayes.records.preparation.defaults import with_idle_masks
        from deabayes.records.preparation.prepared import read_prepared

        records = [read_prepared(path) for path in sorted(self.folder.glob("prepared/*.nc"))]
        records.sort(key=lambda e: (e.role, e.protocol, e.name))
        return {e.name: e for e in with_idle_masks(records)}

    @cached_property
    def analyses(self) -> tuple[AnalysisResults, ...]:
        """Analyses written by the stage `analyse`, in report order; empty if it did not run."""
        folder = self.folder / "analyses"
        index = folder / "index.json"
        entries = json.loads(index.read_text(encoding="utf-8")) if index.is_file() else []
        return tuple(AnalysisResults.of(folder, entry) for entry in entries)

    def analysis(self, name: str) -> AnalysisResults | None:
        """Return an analysis by its name; None if it was not computed or found nothing."""
        return next((a for a in self.analyses if a.name == name and not a.is_empty), None)

    @property
    def provenance(self) -> str:
        return self.recommended.provenance

    @property
    def system(self) -> str:
        return str(self.candidates[0].attributes.get("system", ""))

    @cached_property
    def inputs(self) -> tuple[Path, ...]:
        """Every file that a figure may have been drawn from."""
        patterns = ("study.yaml", "prepared/*.nc", "*/posterior.nc", "*/*.csv", "*.csv",
                    "*/predictions/*.nc", "analyses/index.json", "analyses/*/*")  # fmt: skip
        found = (p for pattern in patterns for p in self.folder.glob(pattern))
        return tuple(sorted(p for p in found if p.parent.name != PREVIEW))


@dataclass(frozen=True)
class CandidateResults:
    """One candidate in `results/{study}/{candidate}`: posterior file, tables and predictions."""

    study: StudyResults
    folder: Path

    @property
    def name(self) -> str:
        return self.folder.name

    @cached_property
    def attributes(self) -> Mapping[str, Any]:
        """Root attributes of the posterior file, decoded from JSON."""
        attributes = self.group(None).attrs
        return {str(key): _decoded(value) for key, value in attributes.items()}

    def group(self, name: str | None) -> xr.Dataset:
        """Load a group of the posterior file; empty if the file has no such group."""
        import h5py
        import xarray as xr

        path = self.folder / "posterior.nc"
        try:
            with h5py.File(path) as file:
                if name is not None and name not in file:
                    return xr.Dataset()
            return xr.load_dataset(path, group=name, engine="h5netcdf")
        except (OSError, ValueError) as error:
            raise UserError(f"{path}: not a readable netCDF file ({error}); fit again") from error

    @cached_property
    def posterior(self) -> xr.Dataset:
        return self.group("posterior")

    @cached_property
    def prior(self) -> xr.Dataset:
        return self.group("prior")

    @cached_property
    def prior_predictive(self) -> xr.Dataset:
        return self.group("prior_predictive")

    @property
    def convergence(self) -> Mapping[str, Any]:
        return self._mapping("convergence")

    @property
    def converged(self) -> bool:
        return bool(self.convergence.get("converged", False))

    @property
    def provenance(self) -> str:
        return str(self.attributes.get("provenance", "measured"))

    @property
    def settings(self) -> Mapping[str, Any]:
        """Settings of the study at the time of the fit."""
        return self._mapping("study")

    def _mapping(self, attribute: str) -> Mapping[str, Any]:
        value = self.attributes.get(attribute)
        return value if isinstance(value, Mapping) else {}

    def gate(self, name: str, default: float) -> float:
        """Limit of a convergence gate in the sampling settings, such as `r_hat` or `ess`."""
        sampling = self.settings.get("sampling")
        return float(sampling.get(name, default)) if isinstance(sampling, Mapping) else default

    def kind(self, name: str) -> str:
        """Kind of a quantity: material | specimen | noise | derived."""
        fallback = "noise" if "." in name else "material"
        return str(self.posterior[name].attrs.get("kind", fallback))

    def names(self, *kinds: str) -> list[str]:
        """Names of the quantities of these kinds, in the order of the file."""
        return [str(n) for n in self.posterior.data_vars if self.kind(str(n)) in kinds]

    @property
    def sampled(self) -> list[str]:
        return self.names("material", "specimen", "noise")

    def label(self, name: str) -> dict[str, str]:
        """Symbol, unit, description and prior of a quantity."""
        keys = ("symbol", "unit", "description", "prior")
        return {key: str(self.posterior[name].attrs.get(key, "")) for key in keys}

    @cached_property
    def summary(self) -> pd.DataFrame | None:
        """Table summary.csv indexed by parameter; None if there is no such file."""
        table = _table(self.folder / "summary.csv")
        return None if table is None else table.set_index(table.columns[0])

    @cached_property
    def errors(self) -> pd.DataFrame | None:
        return _table(self.folder / "errors.csv")

    @cached_property
    def predictions(self) -> Mapping[str, xr.Dataset]:
        """Predictions by experiment, calibration records first."""
        import xarray as xr

        paths = sorted((self.folder / "predictions").glob("*.nc"))
        predictions = [xr.load_dataset(path, engine="h5netcdf") for path in paths]
        predictions.sort(key=lambda p: [p.attrs[n] for n in ("role", "protocol", "experiment")])
        return {str(p.attrs["experiment"]): p for p in predictions}

    @cached_property
    def records(self) -> Mapping[str, Mapping[str, Any]]:
        """Calibration records by name, as stored in the posterior file: `group`, `scale`, ..."""
        return {record["name"]: record for record in self.attributes.get("experiments", [])}

    def noise_group(self, experiment: str) -> str:
        """The noise group an experiment belongs to."""
        if experiment in self.records:
            return str(self.records[experiment]["group"])
        attributes = self.predictions[experiment].attrs
        by_experiment = self.settings.get("noise_groups") == "experiment"
        fallback = experiment if by_experiment else attributes["protocol"]
        return str(attributes.get("noise_group", fallback))

    @property
    def noise(self) -> NoiseModel:
        """Noise model that the candidate was fitted with."""
        from deabayes.noise import REGISTRY as NOISE_MODELS

        return NOISE_MODELS[str(self.attributes["noise"])]()

    def noise_draws(self, experiment: str) -> dict[str, FloatArray]:
        """Draws (W,) of an experiment's noise parameters, by their names in the noise model."""
        group = f"{self.noise_group(experiment)}."
        names = [name for name in self.names("noise") if name.startswith(group)]
        return {name.removeprefix(group): self.posterior[name].values.ravel() for name in names}


def _table(path: Path) -> pd.DataFrame | None:
    import pandas as pd

    try:
        return pd.read_csv(path) if path.is_file() else None
    except (ValueError, pd.errors.ParserError) as error:  # also for an empty file
        raise UserError(f"{path}: is no table ({error}); remove it and make it again") from None


def _decoded(value: object) -> Any:
    if isinstance(value, str) and value[:1] in "[{":
        try:
            return json.loads(value)
        except json.JSONDecodeError:
            return value
    return value


@dataclass(frozen=True)
class PopulationResults:
    """One population in `results/populations/{name}`: mean, spread, specimens, a new specimen."""

    folder: Path

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    @property
    def study(self) -> PopulationResults:
        """This object itself, because a population does not belong to a study."""
        return self

    @cached_property
    def new_specimen(self) -> CandidateResults:
        """The new specimen as a candidate, because its files have the same layout."""
        return CandidateResults(StudyResults(self.folder.parent), self.folder)

    @property
    def attributes(self) -> Mapping[str, Any]:
        return self.new_specimen.attributes

    @property
    def system(self) -> str:
        return str(self.attributes.get("system", ""))

    @property
    def provenance(self) -> str:
        return self.new_specimen.provenance

    @property
    def converged(self) -> bool:
        return self.new_specimen.converged

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that vary between specimens, in the order of the file."""
        return self.new_specimen.names("material", "specimen")

    @property
    def members(self) -> list[str]:
        """Names of the studies of its specimens."""
        return [str(name) for name in self.attributes["population"]["studies"]]

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table summary.csv indexed by quantity."""
        import pandas as pd

        return pd.read_csv(self.folder / "summary.csv", index_col="parameter")

    @cached_property
    def shrinkage(self) -> pd.DataFrame:
        """Table shrinkage.csv, one row per specimen and parameter."""
        import pandas as pd

        return pd.read_csv(self.folder / "shrinkage.csv")

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Every file that a figure may have been drawn from."""
        patterns = ("posterior.nc", "*.csv", "predictions/*.nc")
        return tuple(sorted(p for pattern in patterns for p in self.folder.glob(pattern)))


def results_of(folder: Path) -> StudyResults | PopulationResults:
    """Return a population if the folder holds a population.yaml, else a study."""
    is_population = (folder / SETTINGS).is_file()
    return PopulationResults(folder) if is_population else StudyResults(folder)
