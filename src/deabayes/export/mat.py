"""Draws as a MATLAB struct."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from deabayes.export.table import draws_table, units


def write(tree: xr.DataTree, path: Path) -> None:
    """Structs `draws` and `units`; MATLAB allows no dots in field names, so they become `__`."""
    from scipy.io import savemat

    table = draws_table(tree)
    draws = {str(name).replace(".", "__"): table[name].to_numpy() for name in table.columns}
    labels = {name.replace(".", "__"): unit for name, unit in units(tree).items()}
    with path.open("wb") as stream:
        savemat(stream, {"draws": draws, "units": labels})
