"""Another study's posterior as a prior: what of it holds for this study's specimen."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import UserError
from deabayes.posteriors.counted_records import CountedRecord, counted_records
from deabayes.posteriors.storage import read_tree, specimen_from_json, stacked
from deabayes.prior.from_posterior import PriorFromPosterior
from deabayes.study import Settings

OF_THE_MATERIAL = frozenset({"density", "permittivity", "relative_permittivity"})
"""Quantities that a specimen states and that its material decides."""


@dataclass(frozen=True)
class Inheritance:
    """A posterior that becomes a prior.

    Attributes
    ----------
    same_specimen : whether the draws are of this study's specimen: they know already what was
        measured on it as a whole (`System.log_likelihood_of_quantities`).
    notes : what a reader is to know; `doubts`, why nothing that builds on it has converged.
    counted : the records that the draws know.
    priors : the entries of `priors:` that they were fitted with.
    """

    prior: PriorFromPosterior
    same_specimen: bool
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    counted: tuple[CountedRecord, ...] = ()
    priors: Mapping[str, Settings] = field(default_factory=dict)


def inherit_from(path: Path, specimen: Specimen) -> Inheritance:
    """Read a posterior as the prior of a study of `specimen`.

    The geometry of another specimen says nothing of this one's, and is marginalised; so is a
    property of the material that the two state differently. A population's posterior is of a
    new specimen, and is handed on whole.

    Raises
    ------
    UserError : no posterior file, or nothing in it that holds here.
    """
    tree = read_tree(path)
    theirs = specimen_from_json(tree.attrs["specimen"])
    is_population = "population" in tree.attrs
    same = not is_population and _is_same(theirs, specimen)
    foreign = () if is_population else foreign_quantities(_stated_in(tree), theirs, specimen)
    notes, doubts = [], []
    if foreign:
        notes.append(
            f"prior_from: {', '.join(foreign)} of {theirs.name} say nothing of {specimen.name}; "
            "their priors are what it states itself"
        )
    if theirs.system != specimen.system:
        notes.append(
            f"prior_from: {path} is of another system ({theirs.system}, here {specimen.system}); "
            "what is called alike is taken for the same: is it?"
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
    """The material and specimen parameters of a posterior file, correlations kept."""
    group = tree["posterior"]
    kept = [
        str(name)
        for name, variable in group.data_vars.items()
        if variable.attrs["kind"] in ("material", "specimen") and name not in without
    ]
    if not kept:
        raise UserError("this posterior holds no parameter to hand on")
    draws = np.stack([stacked(group, name) for name in kept], axis=1)
    return PriorFromPosterior(tuple(kept), draws)


def _is_same(one: Specimen, other: Specimen) -> bool:
    return (one.name, one.system) == (other.name, other.system) and _stated(one) == _stated(other)


def foreign_quantities(names: Iterable[str], theirs: Specimen, own: Specimen) -> tuple[str, ...]:
    """Those of what `theirs` states that are only its own, and none of the common material's."""
    if _is_same(theirs, own):
        return ()
    there, here = _stated(theirs), _stated(own)
    return tuple(
        name
        for name in names
        if not (name in OF_THE_MATERIAL and there.get(name) == here.get(name))
    )


def _stated_in(tree: xr.DataTree) -> list[str]:
    """The parameters of a posterior file that its specimen states."""
    variables = tree["posterior"].data_vars.items()
    return [str(name) for name, variable in variables if variable.attrs["kind"] == "specimen"]


def _stated(specimen: Specimen) -> dict[str, tuple[float, str, float | None]]:
    def numbers(quantity: Quantity) -> tuple[float, str, float | None]:
        return quantity.value, quantity.unit, quantity.sd

    return {name: numbers(quantity) for name, quantity in specimen.quantities.items()}
