"""Draws of a posterior file as a table, as exports take them."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from deabayes.faults import UserError
from deabayes.own_models.loading import restore
from deabayes.posteriors.storage import specimen_from_json, stacked
from deabayes.systems import Draws, System, build


def evenly(total: int, size: int) -> NDArray[np.intp]:
    """Indices of `size` of `total` draws in a row, each the middle of an equal part of it."""
    if not 1 <= size <= total:
        raise UserError(f"--draws {size}: the posterior holds {total} draws; take 1 to {total}")
    return (2 * np.arange(size) + 1) * total // (2 * size)


def candidate_of(tree: xr.DataTree) -> System:
    """The candidate of the posterior's specimen."""
    restore(tree.attrs)
    specimen = specimen_from_json(tree.attrs["specimen"])
    return build(specimen.system, tree.attrs["candidate"], specimen)


def whose(tree: xr.DataTree) -> str:
    """The specimen that the draws are of, in words."""
    specimen = specimen_from_json(tree.attrs["specimen"]).name
    if "population" not in tree.attrs:
        return f"specimen {specimen}"
    return (
        f"a new specimen of population {tree.attrs['study_name']} (what the population does not "
        f"cover is that of {specimen})"
    )


def system_and_draws(
    tree: xr.DataTree, picked: NDArray[np.intp] | None = None
) -> tuple[System, Draws]:
    """The candidate, and draws of its parameters: those picked, or all."""
    system = candidate_of(tree)
    names = [parameter.name for parameter in system.parameters()]
    draws = {name: stacked(tree["posterior"], name) for name in names}
    if picked is None:
        return system, draws
    return system, {name: values[picked] for name, values in draws.items()}


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
