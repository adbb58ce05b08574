"""Draws as CSV with `name [unit]` headers."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from deabayes.export.taken import converged, draws_table, units


def write(tree: xr.DataTree, path: Path) -> None:
    """One row per draw; columns of quantities are headed `name [unit]`, SI.

    Without a unit are `ensemble` and, last, `simulated` (from simulated records) and `converged`, 1
    or 0 in every row: a comment above the header would be data to who reads plain CSV, and a text
    in a column is no number to who reads nothing else.
    """
    names = {name: f"{name} [{unit}]" for name, unit in units(tree).items()}
    table = draws_table(tree).rename(columns=names)
    table["simulated"] = int(tree.attrs["provenance"] == "simulated")
    table["converged"] = int(converged(tree))
    table.to_csv(path, index=False)
