"""One specimen of a population: its posterior, and what its prior was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.population.checks import marginal
from deabayes.population.coordinate import Coordinate
from deabayes.population.likelihood import Likelihood, fit
from deabayes.population.silence import telling
from deabayes.posteriors.storage import stacked
from deabayes.prior.joint import Prior

PRIOR_DRAWS = 20000
SEED = 20261122


@dataclass(frozen=True)
class Member:
    """A specimen's draws, seen from the population.

    Attributes
    ----------
    phi : (K, d) draws of the population's parameters in its coordinate.
    log_prior : (K,) log density, as one of phi, of the prior that they were sampled under.
    prior : of the population's parameters; its mean and sd in phi are `prior_mean`, `prior_sd`.
    independent : how many independent draws the K are worth.
    told : (d,), of which parameters its records say anything.
    contraction : of every parameter, by its own records.
    """

    study: str
    phi: FloatArray
    log_prior: FloatArray
    prior: Prior
    prior_mean: FloatArray
    prior_sd: FloatArray
    independent: float
    likelihood: Likelihood
    told: NDArray[np.bool_]
    converged: bool = True
    provenance: str = "measured"
    contraction: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls, study: str, theta: FloatArray, prior: Prior, coordinate: Coordinate, independent: float
    ) -> Member:
        """From draws theta (K, d) of the parameters whose prior `prior` is."""
        rng = np.random.default_rng(SEED)
        phi, prior_phi = (
            coordinate.forward(draws) for draws in (theta, prior.sample(rng, PRIOR_DRAWS))
        )
        log_prior = prior.log_density(theta) + coordinate.log_derivative(theta)
        told = telling(phi, prior_phi, independent)
        likelihood = fit(phi, log_prior, prior_phi, told, independent, rng)
        moments = prior_phi.mean(axis=0), prior_phi.std(axis=0)
        return cls(study, phi, log_prior, prior, *moments, independent, likelihood, told)


def read_members(
    studies: Sequence[str],
    trees: Sequence[xr.DataTree],
    priors: Sequence[Prior],
    names: Sequence[str],
) -> tuple[Coordinate, list[Member]]:
    """The members of a population, and the coordinate of their parameters.

    Parameters
    ----------
    trees : their posterior files.
    priors : of all parameters of each, as they were sampled under.

    Raises
    ------
    UserError : a parameter is missing from a posterior, or its prior is not the one given.
    """
    ordered = [p for p in priors[0].parameters if p.name in names]
    coordinate = Coordinate.of(ordered)
    members = []
    for study, tree, prior in zip(studies, trees, priors, strict=True):
        _check(study, tree, prior, coordinate.names)
        table = tree["summary"].to_dataset().to_dataframe().loc[list(coordinate.names)]
        theta = _draws(tree, coordinate.names)
        independent = float(min(table["ess_bulk"].min(), len(theta)))
        part = marginal(prior, coordinate.names)
        members.append(
            replace(
                Member.of(study, theta, part, coordinate, independent),
                converged=bool(tree["summary"]["converged"].values.all()),
                provenance=str(tree.attrs["provenance"]),
                contraction=table["contraction"].to_dict(),
            )
        )
    return coordinate, members


def _draws(tree: xr.DataTree, names: Sequence[str]) -> FloatArray:
    return np.stack([stacked(tree["posterior"], name) for name in names], axis=1)


def _check(study: str, tree: xr.DataTree, prior: Prior, names: Sequence[str]) -> None:
    """The posterior has the parameters, and was sampled under this prior."""
    missing = [name for name in names if name not in tree["posterior"].data_vars]
    if missing:
        raise UserError(f"study {study}: its posterior has no {missing[0]}; fit it again")
    stored = stacked(tree["log_prior"], "log_prior")
    found = prior.log_density(_draws(tree, prior.names))
    if not np.allclose(found, stored, rtol=1e-6, atol=1e-4):
        raise UserError(
            f"study {study}: its posterior was sampled under another prior than its settings and "
            "`prior_from` give now; fit it again"
        )
