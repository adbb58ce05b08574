"""Read draws, units and provenance of the posterior that is exported."""

from __future__ import annotations

import json

import numpy as np
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


def system_and_draws(tree: xr.DataTree) -> tuple[System, Draws]:
    """Return the candidate and all draws of its parameters."""
    system = candidate_of(tree)
    names = [parameter.name for parameter in system.parameters()]
    return system, {name: stacked(tree["posterior"], name) for name in names}


def identity(tree: xr.DataTree) -> dict[str, str]:
    """Return candidate, system, provenance of the records and version of deabayes, as texts."""
    names = ("candidate", "system", "provenance", "deabayes_version")
    return {name: str(tree.attrs[name]) for name in names}


def converged(tree: xr.DataTree) -> bool:
    """Whether the posterior has converged, so that its draws may be used."""
    return bool(json.loads(tree.attrs["convergence"])["converged"])


def units(tree: xr.DataTree) -> dict[str, str]:
    """Return the SI unit of every quantity."""
    return {str(n): str(v.attrs.get("unit", "1")) for n, v in tree["posterior"].data_vars.items()}


def title(tree: xr.DataTree) -> str:
    """Name the candidate, the system, and the specimen or population that the draws describe."""
    specimen = specimen_from_json(tree.attrs["specimen"]).name
    whose = f"specimen {specimen}"
    if "population" in tree.attrs:
        whose = (
            f"a new specimen of population {tree.attrs['study_name']} (quantities outside the "
            f"population are those of {specimen})"
        )
    return f"{tree.attrs['candidate']} of system {tree.attrs['system']}, {whose}"


def provenance(tree: xr.DataTree) -> str:
    """Say where the records come from."""
    origin = tree.attrs["provenance"]
    shown = "SIMULATED records, not measurements" if origin == "simulated" else origin
    return f"Provenance: {shown}"
