"""Draws as CSV with `name [unit]` headers."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from deabayes.export.table import draws_table, units


def write(tree: xr.DataTree, path: Path) -> None:
    """One row per draw; every column but `ensemble` is headed `name [unit]`, SI."""
    names = {name: f"{name} [{unit}]" for name, unit in units(tree).items()}
    draws_table(tree).rename(columns=names).to_csv(path, index=False)
