"""Use another study's posterior as a prior."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import UserError
from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.records import CountedRecord, counted_records
from deabayes.posteriors.storage import read_tree, specimen_from_json, stacked
from deabayes.prior.from_posterior import PosteriorBlock, PriorFromPosterior
from deabayes.prior.joint import Prior
from deabayes.prior.learned import Learned, Shown
from deabayes.prior.normal_mixture import NormalMixture
from deabayes.study import Settings

OF_THE_MATERIAL = frozenset({"density", "permittivity", "relative_permittivity"})
"""Quantities that a specimen states, but that are properties of its material."""


@dataclass(frozen=True)
class Inheritance:
    """A posterior that becomes a prior.

    Attributes
    ----------
    same_specimen : whether the draws are of this study's specimen. Such draws already use the data
        measured on the specimen as a whole (`System.log_likelihood_of_quantities`).
    notes : warnings for the reader. `doubts` : reasons why no posterior with this prior counts as
        converged.
    counted : the records that the draws already use.
    priors : the entries of `priors:` with which the draws were fitted.
    """

    prior: PriorFromPosterior
    same_specimen: bool
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    counted: tuple[CountedRecord, ...] = ()
    priors: Mapping[str, Settings] = field(default_factory=dict)


def inherit_from(path: Path, specimen: Specimen) -> Inheritance:
    """Read a posterior as the prior of a study of `specimen`.

    The geometry of another specimen says nothing about this specimen, and is marginalised. A
    material property that the two specimens state differently is marginalised too. A population's
    posterior describes a new specimen, and all its parameters are inherited.

    Raises
    ------
    UserError : the file is no posterior file, or none of its parameters applies here.
    """
    tree = read_tree(path)
    theirs = specimen_from_json(tree.attrs["specimen"])
    is_population = "population" in tree.attrs
    same = not is_population and _is_same(theirs, specimen)
    foreign = () if is_population else foreign_quantities(_stated_in(tree), theirs, specimen)
    notes, doubts = [], []
    if foreign:
        notes.append(
            f"prior_from: {', '.join(foreign)} of {theirs.name} do not apply to {specimen.name}, "
            "which uses the priors of its own specimen.yaml"
        )
    if theirs.system != specimen.system:
        notes.append(
            f"prior_from: {path} is of another system ({theirs.system}, here {specimen.system}). "
            "Parameters of the same name count as the same quantity; check that they are"
        )
    if not json.loads(tree.attrs["convergence"])["converged"]:
        doubts.append(f"its prior is the posterior {path}, which did not converge")
    return Inheritance(
        handed_on(tree, foreign),
        same,
        tuple(notes),
        tuple(doubts),
        counted_records(tree),
        json.loads(tree.attrs["study"]).get("priors", {}),
    )


def handed_on(tree: xr.DataTree, without: tuple[str, ...] = ()) -> PriorFromPosterior:
    """Return the material and specimen parameters of a posterior file, with correlations."""
    group = tree["posterior"]
    kept = [
        str(name)
        for name, variable in group.data_vars.items()
        if variable.attrs["kind"] in ("material", "specimen") and name not in without
    ]
    if not kept:
        raise UserError("this posterior holds no parameter that could be used as a prior")
    draws = np.stack([stacked(group, name) for name in kept], axis=1)
    return PriorFromPosterior(tuple(kept), draws)


def _is_same(one: Specimen, other: Specimen) -> bool:
    return (one.name, one.system) == (other.name, other.system) and _stated(one) == _stated(other)


def foreign_quantities(names: Iterable[str], theirs: Specimen, own: Specimen) -> tuple[str, ...]:
    """Return which of `names` apply only to the specimen `theirs`, and not to `own`.

    A quantity of the material applies to both specimens if both state it equally.
    """
    if _is_same(theirs, own):
        return ()
    there, here = _stated(theirs), _stated(own)
    return tuple(
        name
        for name in names
        if not (name in OF_THE_MATERIAL and there.get(name) == here.get(name))
    )


def _stated_in(tree: xr.DataTree) -> list[str]:
    """Return the parameters of a posterior file that its specimen states."""
    variables = tree["posterior"].data_vars.items()
    return [str(name) for name, variable in variables if variable.attrs["kind"] == "specimen"]


def _stated(specimen: Specimen) -> dict[str, tuple[float, str, float | None]]:
    def numbers(quantity: Quantity) -> tuple[float, str, float | None]:
        return quantity.value, quantity.unit, quantity.sd

    return {name: numbers(quantity) for name, quantity in specimen.quantities.items()}


GROUP = "inherited_prior"


def inherited_prior(target: LogPosterior) -> xr.Dataset:
    """Return weights, means and factors of the inherited mixture; none if only predictions inherit.

    With a learned likelihood, the dataset also holds its arrays (see `learned.Learned`).
    """
    dataset = xr.Dataset(attrs={"quantities_counted": int(target.quantities_counted)})
    for block in target.prior.inherited:
        mixture = block.mixture
        dataset = dataset.assign(
            weights=("component", mixture.weights),
            means=(("component", "parameter"), mixture.means),
            factors=(("component", "parameter", "score"), mixture.factors),
        ).assign_coords(parameter=list(block.names))
        dataset.attrs["misfit"] = block.misfit
        if block.learned is not None:
            dataset = dataset.assign(
                learned_centre=("feature", block.learned.centre),
                learned_directions=(("feature", "direction"), block.learned.directions),
                learned_coefficients=("monomial", block.learned.coefficients),
            )
    return dataset


def with_inherited_prior(target: LogPosterior, tree: xr.DataTree) -> LogPosterior:
    """Return a candidate's log-posterior with the prior that its posterior file holds."""
    if GROUP not in tree.children:
        return target
    stored, prior = tree[GROUP].to_dataset(), target.prior
    if "weights" in stored:
        arrays = (np.asarray(stored[name].values) for name in ("weights", "means", "factors"))
        names = tuple(str(name) for name in stored["parameter"].values)
        misfit, learned = float(stored.attrs["misfit"]), _learned(prior, names, stored)
        block = PosteriorBlock(names, NormalMixture(*arrays), misfit, learned)
        prior = Prior(prior.parameters, prior.minimum_ratios, (block,))
    return replace(target, prior=prior, quantities_counted=bool(stored.attrs["quantities_counted"]))


def _learned(prior: Prior, names: tuple[str, ...], stored: xr.Dataset) -> Learned | None:
    if "learned_centre" not in stored:
        return None
    parameters = {p.name: p for p in prior.parameters}
    arrays = (stored[f"learned_{name}"].values for name in ("centre", "directions", "coefficients"))
    return Learned(Shown.by([parameters[name] for name in names]), *map(np.asarray, arrays))
