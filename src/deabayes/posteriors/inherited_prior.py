"""A prior that was another posterior, as the posterior file that builds on it holds it.

The other file may be elsewhere later, or fitted again: these draws are of the prior it was then.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from deabayes.posterior import LogPosterior
from deabayes.prior.from_posterior import PosteriorBlock
from deabayes.prior.joint import Prior
from deabayes.prior.normal_mixture import NormalMixture
from deabayes.prior.transport import Transport
from deabayes.warp import Warp

GROUP = "inherited_prior"
WARP = "warp_"
"""Before the names of a warp's arrays."""


def inherited_prior(target: LogPosterior) -> xr.Dataset:
    """What makes it of a standard normal vector; none where only predictions inherit."""
    found = xr.Dataset(attrs={"quantities_counted": int(target.quantities_counted)})
    for block in target.prior.inherited:
        mixture, warp = block.transport.mixture, block.transport.warp
        found = found.assign(
            weights=("component", mixture.weights),
            means=(("component", "parameter"), mixture.means),
            factors=(("component", "parameter", "score"), mixture.factors),
        ).assign_coords(parameter=list(block.names))
        found = found.assign({} if warp is None else _variables(warp))
        found.attrs["misfit"] = block.misfit
    return found


def with_inherited_prior(target: LogPosterior, tree: xr.DataTree) -> LogPosterior:
    """A candidate's log-posterior under the prior that its posterior file holds."""
    if GROUP not in tree.children:
        return target
    found, prior = tree[GROUP].to_dataset(), target.prior
    if "weights" in found:
        arrays = (np.asarray(found[name].values) for name in ("weights", "means", "factors"))
        names = tuple(str(name) for name in found["parameter"].values)
        transport = Transport(NormalMixture(*arrays), _warp(found))
        block = PosteriorBlock(names, transport, float(found.attrs["misfit"]))
        prior = Prior(prior.parameters, prior.minimum_ratios, (block,))
    return replace(target, prior=prior, quantities_counted=bool(found.attrs["quantities_counted"]))


def _variables(warp: Warp) -> dict[str, xr.Variable]:
    """A warp's arrays, each with dimensions of its own."""
    return {
        WARP + name: xr.Variable([f"{WARP}{name}_{axis}" for axis in range(array.ndim)], array)
        for name, array in warp.arrays().items()
    }


def _warp(found: xr.Dataset) -> Warp | None:
    arrays = {
        str(name).removeprefix(WARP): np.asarray(variable.values)
        for name, variable in found.data_vars.items()
        if str(name).startswith(WARP)
    }
    return Warp.from_arrays(arrays) if arrays else None
