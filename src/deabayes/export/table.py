"""Posterior draws as a table: one row per draw, one column per quantity, SI."""

from __future__ import annotations

import json

import pandas as pd
import xarray as xr

from deabayes.posteriors.storage import stacked

STATED = ("candidate", "system", "provenance", "deabayes_version")


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


def stated(tree: xr.DataTree) -> dict[str, str]:
    """Where draws come from, as texts; `provenance` is that of the records."""
    return {name: str(tree.attrs[name]) for name in STATED}


def converged(tree: xr.DataTree) -> bool:
    """Whether draws may be used."""
    return bool(json.loads(tree.attrs["convergence"])["converged"])


def units(tree: xr.DataTree) -> dict[str, str]:
    """Quantity -> SI unit."""
    return {str(n): str(v.attrs.get("unit", "1")) for n, v in tree["posterior"].data_vars.items()}
