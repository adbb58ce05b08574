"""Parameters and derived quantities of a posterior: what they are called, and summary.csv."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior, log_standard_normal
from deabayes.posteriors.content import PosteriorContent
from deabayes.posteriors.power_scaling import sensitivities
from deabayes.prior.joint import Prior

SUMMARY_COLUMNS = (
    "symbol unit mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat contraction "
    "prior_sensitivity likelihood_sensitivity converged"
).split()


def quantities(target: LogPosterior, theta: FloatArray) -> dict[str, FloatArray]:
    """Every sampled parameter and derived quantity by name, each (W,), for theta (W, d)."""
    draws = target.draws(theta)
    derived = {name: d.values for name, d in target.system.derived(draws).items()}
    return {**draws, **derived}


def summary_table(
    content: PosteriorContent, theta: FloatArray, prior_theta: FloatArray
) -> pd.DataFrame:
    """The table of summary.csv, indexed by quantity.

    contraction: see `contractions`.
    prior_sensitivity and likelihood_sensitivity: see `power_sensitivities`.
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
    """Column of the summary -> quantity -> `power_scaling.sensitivities`.

    The prior's density that is raised to a power is N(z; 0, I), corrected where it is not quite
    the prior (`Prior.log_correction`): a power of a density depends
    on the coordinate, and in this one a power above 1 draws every prior together about its
    median, those with bounds and inherited ones too. How far a quantity moves is measured on
    the scale of `contraction` for derived quantities.

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
    """1 - var_posterior / var_prior of every quantity.

    On the scale on which its law is normal for a sampled parameter: by z, or, where z tells of it
    only what others leave open (`Prior.scored_alone`), by its own draws. Parts, products and
    derived quantities are taken on their logarithm or, where they change sign, their value.

    Parameters
    ----------
    z : (S, d), of the posterior's draws.
    posterior, before : draws of every quantity, after and before the data.
    """
    gained = {name: contraction(posterior[name], before[name]) for name in posterior}
    for parameter, variance in zip(prior.parameters, z.var(axis=0), strict=True):
        name = parameter.name
        if name in prior.scored_alone:
            gained[name] = 1.0 - float(variance)
        elif name in posterior and not (parameter.part_of or parameter.half_product_with):
            scores = (parameter.prior.to_normal(draws[name]) for draws in (posterior, before))
            gained[name] = _narrower(*scores)
    return {name: gained[name] for name in posterior}


def contraction(posterior: FloatArray, prior: FloatArray) -> float:
    """That of draws, on their logarithm where they are positive."""
    return _narrower(*_scaled(posterior, prior))


def _narrower(after: FloatArray, before: FloatArray) -> float:
    """By half the distance of the 16 and 84 % quantiles: tails do not count."""
    new, old = (np.ptp(np.quantile(draws, [0.16, 0.84])) for draws in (after, before))
    return float(1.0 - (new / max(old, 1e-300)) ** 2)


def _scaled(posterior: FloatArray, prior: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Draws, of the prior only finite ones, on their logarithm where all are positive."""
    prior = prior[np.isfinite(prior)]
    if np.all(posterior > 0) and np.all(prior > 0):
        return np.log(posterior), np.log(prior)
    return posterior, prior


def labels(content: PosteriorContent, theta: FloatArray) -> dict[str, dict[str, str]]:
    """Symbol, unit, description, prior and kind of every quantity."""
    target = content.target
    quantity_names = set(target.system.stated())
    found = {
        p.name: {
            "symbol": p.symbol,
            "unit": p.unit,
            "description": p.description,
            "prior": target.prior.describe(p.name),
            "kind": "noise"
            if "." in p.name
            else ("specimen" if p.name in quantity_names else "material"),
        }
        for p in target.prior.parameters
    }
    for name, d in target.system.derived(target.draws(theta[:2])).items():
        found[name] = {
            "symbol": d.symbol,
            "unit": d.unit,
            "description": d.description,
            "prior": "",
            "kind": "derived",
        }
    return found
