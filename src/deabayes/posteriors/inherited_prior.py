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

GROUP = "inherited_prior"


def inherited_prior(target: LogPosterior) -> xr.Dataset:
    """Weights, means and factors of the mixture; none where only predictions inherit."""
    found = xr.Dataset(attrs={"quantities_counted": int(target.quantities_counted)})
    for block in target.prior.inherited:
        mixture = block.mixture
        found = found.assign(
            weights=("component", mixture.weights),
            means=(("component", "parameter"), mixture.means),
            factors=(("component", "parameter", "score"), mixture.factors),
        ).assign_coords(parameter=list(block.names))
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
        block = PosteriorBlock(names, NormalMixture(*arrays), float(found.attrs["misfit"]))
        prior = Prior(prior.parameters, prior.minimum_ratios, (block,))
    return replace(target, prior=prior, quantities_counted=bool(found.attrs["quantities_counted"]))
