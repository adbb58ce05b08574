"""A population's results files, read when they are needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deabayes.figures.results import CandidateResults, StudyResults

if TYPE_CHECKING:
    import pandas as pd

SETTINGS = "population.yaml"


@dataclass(frozen=True)
class PopulationResults:
    """`results/populations/{name}`: mean and spread, the specimens, a new specimen."""

    folder: Path

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    @property
    def study(self) -> PopulationResults:
        """Itself: a population is no candidate of a study."""
        return self

    @cached_property
    def new_specimen(self) -> CandidateResults:
        """Its posterior file, summary and predictions are laid out as a candidate's."""
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

    @cached_property
    def settings(self) -> Mapping[str, Any]:
        """As the population was put together with."""
        found: Mapping[str, Any] = self.attributes["population"]
        return found

    @property
    def parameters(self) -> list[str]:
        """Those that scatter between specimens, in the file's order."""
        return self.new_specimen.names("material", "specimen")

    @property
    def members(self) -> list[str]:
        return [str(name) for name in self.settings["studies"]]

    @cached_property
    def summary(self) -> pd.DataFrame:
        """summary.csv indexed by quantity."""
        import pandas as pd

        return pd.read_csv(self.folder / "summary.csv", index_col="parameter")

    @cached_property
    def shrinkage(self) -> pd.DataFrame:
        """shrinkage.csv, one row per specimen and parameter."""
        import pandas as pd

        return pd.read_csv(self.folder / "shrinkage.csv")

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Every file that a figure may have been drawn from."""
        patterns = ("posterior.nc", "*.csv", "predictions/*.nc")
        return tuple(sorted(p for pattern in patterns for p in self.folder.glob(pattern)))


def results_of(folder: Path) -> StudyResults | PopulationResults:
    """What a results folder holds, by its settings file."""
    is_population = (folder / SETTINGS).is_file()
    return PopulationResults(folder) if is_population else StudyResults(folder)
