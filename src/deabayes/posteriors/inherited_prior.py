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
from deabayes.prior.learned import Learned, Shown
from deabayes.prior.normal_mixture import NormalMixture

GROUP = "inherited_prior"


def inherited_prior(target: LogPosterior) -> xr.Dataset:
    """Weights, means and factors of the mixture; none where only predictions inherit.

    With a learned likelihood also what it is a quadratic of: see `learned.Learned`.
    """
    found = xr.Dataset(attrs={"quantities_counted": int(target.quantities_counted)})
    for block in target.prior.inherited:
        mixture = block.mixture
        found = found.assign(
            weights=("component", mixture.weights),
            means=(("component", "parameter"), mixture.means),
            factors=(("component", "parameter", "score"), mixture.factors),
        ).assign_coords(parameter=list(block.names))
        found.attrs["misfit"] = block.misfit
        if block.learned is not None:
            found = found.assign(
                learned_centre=("feature", block.learned.centre),
                learned_directions=(("feature", "direction"), block.learned.directions),
                learned_coefficients=("monomial", block.learned.coefficients),
            )
    return found


def with_inherited_prior(target: LogPosterior, tree: xr.DataTree) -> LogPosterior:
    """A candidate's log-posterior under the prior that its posterior file holds."""
    if GROUP not in tree.children:
        return target
    found, prior = tree[GROUP].to_dataset(), target.prior
    if "weights" in found:
        arrays = (np.asarray(found[name].values) for name in ("weights", "means", "factors"))
        names = tuple(str(name) for name in found["parameter"].values)
        misfit, learned = float(found.attrs["misfit"]), _learned(prior, names, found)
        block = PosteriorBlock(names, NormalMixture(*arrays), misfit, learned)
        prior = Prior(prior.parameters, prior.minimum_ratios, (block,))
    return replace(target, prior=prior, quantities_counted=bool(found.attrs["quantities_counted"]))


def _learned(prior: Prior, names: tuple[str, ...], found: xr.Dataset) -> Learned | None:
    if "learned_centre" not in found:
        return None
    parameters = {p.name: p for p in prior.parameters}
    arrays = (found[f"learned_{name}"].values for name in ("centre", "directions", "coefficients"))
    return Learned(Shown.by([parameters[name] for name in names]), *map(np.asarray, arrays))
