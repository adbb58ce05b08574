"""Posterior draws as a table: one row per draw, one column per quantity, SI."""

from __future__ import annotations

import pandas as pd
import xarray as xr

from deabayes.posteriors.storage import stacked


def draws_table(tree: xr.DataTree, kinds: tuple[str, ...] | None = None) -> pd.DataFrame:
    """All draws, ensembles one after the other, with the ensemble's number as a column.

    `kinds` limits the columns to material, specimen, noise or derived quantities.
    """
    group = tree["posterior"]
    names = [
        str(name)
        for name, variable in group.data_vars.items()
        if kinds is None or variable.attrs.get("kind") in kinds
    ]
    chains, size = group.sizes["chain"], group.sizes["draw"]
    table = pd.DataFrame({name: stacked(group, name) for name in names})
    table.insert(0, "ensemble", [chain for chain in range(chains) for _ in range(size)])
    return table


def units(tree: xr.DataTree) -> dict[str, str]:
    """Quantity -> SI unit."""
    return {str(n): str(v.attrs.get("unit", "1")) for n, v in tree["posterior"].data_vars.items()}
