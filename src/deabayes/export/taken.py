"""What several exports take from a posterior file: its candidate, and draws of its parameters."""

from __future__ import annotations

import numpy as np
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
