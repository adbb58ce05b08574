"""What the stage `analyse` left of one analysis, read when it is needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class AnalysisResults:
    """`results/{study}/analyses/{name}`: its title and caption, tables and curves by name."""

    folder: Path
    title: str
    caption: str
    table_names: tuple[str, ...]
    curve_names: tuple[str, ...]

    @classmethod
    def of(cls, folder: Path, entry: Mapping[str, Any]) -> AnalysisResults:
        """From an entry of index.json."""
        names = (tuple(entry[kind]) for kind in ("tables", "curves"))
        return cls(folder / entry["name"], entry["title"], entry["caption"], *names)

    @property
    def name(self) -> str:
        return self.folder.name

    @cached_property
    def tables(self) -> Mapping[str, pd.DataFrame]:
        import pandas as pd

        return {name: pd.read_csv(self.folder / f"{name}.csv") for name in self.table_names}

    @cached_property
    def curves(self) -> Mapping[str, xr.Dataset]:
        import xarray as xr

        files = {name: self.folder / f"{name}.nc" for name in self.curve_names}
        return {name: xr.load_dataset(file, engine="h5netcdf") for name, file in files.items()}
