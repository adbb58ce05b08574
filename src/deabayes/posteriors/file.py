"""Build the content of a posterior file, and the summary of its parameters."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import deabayes
from deabayes.experiment import FloatArray
from deabayes.inference.blocks import (
    FEWEST_BLOCKS,
    block_edges,
    block_log_likelihood,
    block_names,
    block_places,
)
from deabayes.inference.log_posterior import LogPosterior, log_standard_normal
from deabayes.own_models.loading import recorded
from deabayes.posteriors.content import PosteriorContent
from deabayes.posteriors.inheritance import GROUP, inherited_prior
from deabayes.posteriors.records import ATTRIBUTE, CountedRecord, to_json
from deabayes.posteriors.sensitivity import sensitivities
from deabayes.posteriors.storage import specimen_to_json
from deabayes.prediction.calibrated import CalibratedRecord, records_to_json
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter
from deabayes.study import to_settings
from deabayes.systems.base import Derived

SUMMARY_COLUMNS = (
    "symbol unit mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat contraction "
    "prior_sensitivity likelihood_sensitivity converged"
).split()


def quantities(target: LogPosterior, theta: FloatArray) -> dict[str, FloatArray]:
    """Return every sampled parameter and derived quantity, (W,) by name, for theta (W, d)."""
    draws = target.draws(theta)
    derived = {name: d.values for name, d in target.system.derived(draws).items()}
    return {**draws, **derived}


def summary_table(
    content: PosteriorContent, theta: FloatArray, prior_theta: FloatArray
) -> pd.DataFrame:
    """Return the table of summary.csv, indexed by quantity.

    `contractions` explains the column contraction. `power_sensitivities` explains the columns
    prior_sensitivity and likelihood_sensitivity.
    """
    target = content.target
    table = content.diagnostics.copy()
    attributes = labels(content, theta)
    table["converged"] = bool(content.convergence["converged"])
    table["symbol"] = [attributes[name]["symbol"] for name in table.index]
    table["unit"] = [attributes[name]["unit"] for name in table.index]
    posterior, prior = quantities(target, theta), quantities(target, prior_theta)
    z = content.z.reshape(-1, target.dimension)
    gained = contractions(target.prior, z, posterior, prior)
    table["contraction"] = [gained[name] for name in table.index]
    for column, values in power_sensitivities(content, posterior, prior).items():
        table[column] = [values[name] for name in table.index]
    return table[list(SUMMARY_COLUMNS)]


def power_sensitivities(
    content: PosteriorContent,
    posterior: Mapping[str, FloatArray],
    prior: Mapping[str, FloatArray],
) -> dict[str, dict[str, float]]:
    """Return the sensitivities of the summary: column -> quantity -> value (see `sensitivities`).

    The prior density that is raised to a power is N(z; 0, I). `Prior.log_correction` corrects it
    where it is not quite the prior. A power of a density depends on the coordinate. In z, a power
    above 1 contracts every prior about its median, also priors with bounds and inherited priors.
    The movement of a quantity is measured on the scale of `contraction` for derived quantities.

    Parameters
    ----------
    posterior, prior : draws of every quantity.
    """
    z, prior_of = content.z.reshape(-1, content.target.dimension), content.target.prior
    log_prior = log_standard_normal(z) + prior_of.log_correction(prior_of.to_parameters(z), z)
    log_likelihood = content.log_posterior.reshape(-1) - log_prior
    draws = {name: _scaled(posterior[name], prior[name])[0] for name in posterior}
    effective = content.diagnostics["ess_bulk"].clip(upper=log_prior.size).to_dict()
    return {
        "prior_sensitivity": sensitivities(log_prior, draws, effective),
        "likelihood_sensitivity": sensitivities(log_likelihood, draws, effective),
    }


def contractions(
    prior: Prior,
    z: FloatArray,
    posterior: Mapping[str, FloatArray],
    before: Mapping[str, FloatArray],
) -> dict[str, float]:
    """Return 1 - var_posterior / var_prior of every quantity.

    A sampled parameter is compared on the scale on which its prior is normal. This scale is z if z
    depends on this parameter alone (`Prior.scored_alone`). Otherwise the normal scores of its own
    draws are used. Parts, products and derived quantities are compared by their logarithm, or by
    their value if they change sign.

    Parameters
    ----------
    z : (S, d), z of the posterior's draws.
    posterior, before : draws of every quantity, after and before the data.
    """
    gained = {name: contraction(posterior[name], before[name]) for name in posterior}
    for parameter, variance in zip(prior.parameters, z.var(axis=0), strict=True):
        name = parameter.name
        if name in prior.scored_alone:
            gained[name] = 1.0 - float(variance)
        elif name in posterior and not (parameter.part_of or parameter.half_product_with):
            scores = (parameter.prior.to_normal(draws[name]) for draws in (posterior, before))
            gained[name] = narrowing(*scores)
    return {name: gained[name] for name in posterior}


def contraction(posterior: FloatArray, prior: FloatArray) -> float:
    """Return the contraction from prior to posterior draws, by their logarithm if positive."""
    return narrowing(*_scaled(posterior, prior))


def narrowing(after: FloatArray, before: FloatArray) -> float:
    """Return the contraction by the distance of the 16 and 84 % quantiles, which ignores tails."""
    new, old = (np.ptp(np.quantile(draws, [0.16, 0.84])) for draws in (after, before))
    return float(1.0 - (new / max(old, 1e-300)) ** 2)


def _scaled(posterior: FloatArray, prior: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return posterior draws and finite prior draws, as logarithms if all are positive."""
    prior = prior[np.isfinite(prior)]
    if np.all(posterior > 0) and np.all(prior > 0):
        return np.log(posterior), np.log(prior)
    return posterior, prior


def label(quantity: Parameter | Derived, prior: str, kind: str) -> dict[str, str]:
    """Return the attributes of a quantity in a posterior file."""
    return {
        "symbol": quantity.symbol,
        "unit": quantity.unit,
        "description": quantity.description,
        "prior": prior,
        "kind": kind,
    }


def labels(content: PosteriorContent, theta: FloatArray) -> dict[str, dict[str, str]]:
    """Return the label of every quantity; theta (W, d) are any draws."""
    target = content.target
    of_specimen = set(target.system.stated())
    attributes = {}
    for p in target.prior.parameters:
        kind = "specimen" if p.name in of_specimen else "material"
        kind = "noise" if "." in p.name else kind
        attributes[p.name] = label(p, target.prior.describe(p.name), kind)
    for name, derived in target.system.derived(target.draws(theta[:2])).items():
        attributes[name] = label(derived, "", "derived")
    return attributes


def summary_dataset(summary: pd.DataFrame) -> xr.Dataset:
    """Return a table indexed by quantity as the group `summary` of a posterior file."""
    return xr.Dataset(
        {str(name): ("quantity", summary[name].to_numpy()) for name in summary.columns},
        coords={"quantity": list(summary.index)},
    )


STORED_PRIOR_DRAWS = 1000
COMPARED_PRIOR_DRAWS = 10_000
"""Prior draws with which the posterior's widths are compared; contraction scatters by 0.02."""
PRIOR_PREDICTIVE_DRAWS = 50
POSTERIOR_PREDICTIVE_DRAWS = 100
"""Of all ensembles together."""


def posterior_tree(content: PosteriorContent) -> xr.DataTree:
    """Return the ArviZ DataTree of a fitted candidate (groups as in interface.md, Results)."""
    theta = content.target.prior.to_parameters(content.z.reshape(-1, content.z.shape[2]))
    rng = np.random.default_rng(content.seed)
    prior_theta = content.target.prior.sample(rng, COMPARED_PRIOR_DRAWS)
    summary = summary_table(content, theta, prior_theta)
    prior_theta = prior_theta[:STORED_PRIOR_DRAWS]
    shape = content.z.shape[:2]
    log_prior = content.target.prior.log_density(theta).reshape(shape)
    groups = {
        "posterior": _draws(content, theta, shape).merge(_further(content)),
        "sample_stats": xr.Dataset({"lp": (("chain", "draw"), content.log_posterior)}),
        "unconstrained_posterior": xr.Dataset({"z": (("chain", "draw", "dimension"), content.z)}),
        "log_likelihood": _log_likelihood(content, theta, shape),
        "log_prior": xr.Dataset({"log_prior": (("chain", "draw"), log_prior)}),
        "prior": _draws(content, prior_theta, (1, STORED_PRIOR_DRAWS)),
        "prior_predictive": _prior_predictive(content, prior_theta[:PRIOR_PREDICTIVE_DRAWS]),
        "posterior_predictive": _posterior_predictive(content, theta, shape),
        "observed_data": _observed(content),
        "summary": summary_dataset(summary),
    }
    if content.study.prior_from is not None:
        groups[GROUP] = inherited_prior(content.target)
    tree = xr.DataTree.from_dict(groups)
    tree.attrs.update(_attributes(content))
    return tree


def _draws(content: PosteriorContent, theta: FloatArray, shape: tuple[int, int]) -> xr.Dataset:
    described = labels(content, theta)
    return xr.Dataset(
        {
            name: (("chain", "draw"), values.reshape(shape), described[name])
            for name, values in quantities(content.target, theta).items()
        },
        coords=_every_draw(shape),
    )


def _every_draw(shape: tuple[int, int]) -> dict[str, NDArray[np.intp]]:
    return {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])}


def _stream(content: PosteriorContent, index: int) -> np.random.Generator:
    """Return random numbers of their own for one part of the file."""
    key = (*content.seed.spawn_key, index)
    return np.random.default_rng(np.random.SeedSequence(content.seed.entropy, spawn_key=key))


def _further(content: PosteriorContent) -> xr.Dataset:
    """Return prior draws of the parameters that no fitted record informs."""
    if content.further is None:
        return xr.Dataset()
    shape = content.z.shape[:2]
    theta = content.further.sample(_stream(content, 1), int(np.prod(shape)))
    variables = {}
    for p, column in zip(content.further.parameters, theta.T, strict=True):
        attributes = label(p, content.further.describe(p.name), "prior")
        attributes["description"] += "; not fitted, drawn from its prior"
        variables[p.name] = (("chain", "draw"), column.reshape(shape), attributes)
    return xr.Dataset(variables)


def _log_likelihood(
    content: PosteriorContent, theta: FloatArray, shape: tuple[int, int]
) -> xr.Dataset:
    """Return log p(block | points before it, theta) of each block of each record, for `loo`.

    A block is a tenth of its record, so that candidates of one study have the same blocks. The
    terms of a record add up to its log-likelihood. Single precision halves the size and moves
    `loo` by less than 0.001.
    """
    target = content.target
    edges = {
        r.experiment.name: block_edges(
            r.noise_coordinate, float(np.ptp(r.noise_coordinate)) / FEWEST_BLOCKS
        )
        for r in target.records
    }
    with np.errstate(all="ignore"):
        terms = block_log_likelihood(target, theta, edges)
    terms = np.where(np.isfinite(terms), terms, -np.inf).astype(np.float32)
    places = block_places(target, edges)
    experiments = {r.experiment.name: r.experiment for r in target.records}
    return xr.Dataset(
        {"blocks": (("chain", "draw", "block"), terms.reshape(*shape, -1))},
        coords={
            **_every_draw(shape),
            "block": list(block_names(experiments, places)),
            "record": ("block", [name for name, _ in places]),
        },
    )


def _observed(content: PosteriorContent) -> xr.Dataset:
    variables, coordinates = {}, {}
    for record in content.target.records:
        e = record.experiment
        dimension = f"{e.name}_coordinate"
        variables[e.name] = (dimension, e.response, {"units": e.response_unit})
        coordinates[dimension] = (
            dimension,
            e.coordinate,
            {"units": e.coordinate_unit, "name": e.coordinate_name},
        )
    return xr.Dataset(variables, coords=coordinates)


def _prior_predictive(content: PosteriorContent, theta: FloatArray) -> xr.Dataset:
    variables = {
        name: (("chain", "draw", f"{name}_coordinate"), values[None])
        for name, values in content.target.responses(theta).items()
    }
    return xr.Dataset(variables, coords=_observed(content).coords)


def _posterior_predictive(
    content: PosteriorContent, theta: FloatArray, shape: tuple[int, int]
) -> xr.Dataset:
    """Return repetitions of each record: the model's curve of a draw, plus noise drawn anew.

    The draws are evenly taken from all ensembles; the coordinate `draw` is that of the posterior.
    Single precision halves the size.
    """
    target, rng = content.target, _stream(content, 2)
    size = min(-(-POSTERIOR_PREDICTIVE_DRAWS // shape[0]), shape[1])
    taken = np.linspace(0, shape[1] - 1, size).astype(int)
    draws = target.draws(theta.reshape(*shape, -1)[:, taken].reshape(-1, theta.shape[1]))
    variables = {}
    for record in target.records:
        discrepancy, white = target.noise.sample(
            rng, record.noise_coordinate, record.weights, target.noise_draws(draws, record)
        )
        values = record.scale.with_residuals(record.simulate(draws), discrepancy + white)
        name, unit = record.experiment.name, {"units": record.experiment.response_unit}
        dimensions = ("chain", "draw", f"{name}_coordinate")
        values = values.reshape(shape[0], size, -1).astype(np.float32)
        variables[name] = (dimensions, values, unit)
    where = {"chain": np.arange(shape[0]), "draw": taken}
    return xr.Dataset(variables, coords={**_observed(content).coords, **where})


def _attributes(content: PosteriorContent) -> dict[str, str]:
    target, study = content.target, content.study
    records = [
        CalibratedRecord.of(r.experiment, r.group, r.scale, r.correlated_scale)
        for r in target.records
    ]
    counted = [CountedRecord.of(study.name, r.experiment) for r in target.records]
    return {
        "study": json.dumps(to_settings(study)),
        "study_name": study.name,
        "candidate": content.candidate,
        "order": str(target.system.order),
        "system": content.specimen.system,
        **recorded(content.specimen.system),
        "specimen": specimen_to_json(content.specimen),
        "provenance": content.specimen.provenance.get("kind", "measured"),
        "noise": study.noise,
        "experiments": records_to_json(records),
        ATTRIBUTE: to_json([*counted, *content.counted_before]),
        "convergence": json.dumps(content.convergence),
        "warnings": json.dumps(list(content.warnings)),
        "leaning": json.dumps(list(content.leaning)),
        "deabayes_version": deabayes.__version__,
    }
