"""Read draws, units and provenance of a posterior file for exports."""

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
    """Return indices of `size` evenly spaced draws out of `total`."""
    if not 1 <= size <= total:
        raise UserError(f"--draws {size}: the posterior holds {total} draws; take 1 to {total}")
    return (2 * np.arange(size) + 1) * total // (2 * size)


def candidate_of(tree: xr.DataTree) -> System:
    """Build the posterior's candidate for the posterior's specimen."""
    restore(tree.attrs)
    specimen = specimen_from_json(tree.attrs["specimen"])
    return build(specimen.system, tree.attrs["candidate"], specimen)


def whose(tree: xr.DataTree) -> str:
    """Describe the specimen to which the draws belong."""
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
    """Return the candidate and draws of its parameters; `picked` selects draws, by default all."""
    system = candidate_of(tree)
    names = [parameter.name for parameter in system.parameters()]
    draws = {name: stacked(tree["posterior"], name) for name in names}
    if picked is None:
        return system, draws
    return system, {name: values[picked] for name, values in draws.items()}


STATED = ("candidate", "system", "provenance", "deabayes_version")


def draws_table(tree: xr.DataTree, kinds: tuple[str, ...] | None = None) -> pd.DataFrame:
    """Tabulate all draws, one ensemble after the other; a column holds the ensemble's number.

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
    """Return candidate, system, provenance of the records and version of deabayes, as texts."""
    return {name: str(tree.attrs[name]) for name in STATED}


def converged(tree: xr.DataTree) -> bool:
    """Whether the posterior has converged, so that its draws may be used."""
    return bool(json.loads(tree.attrs["convergence"])["converged"])


def units(tree: xr.DataTree) -> dict[str, str]:
    """Return the SI unit of every quantity."""
    return {str(n): str(v.attrs.get("unit", "1")) for n, v in tree["posterior"].data_vars.items()}
