"""Parameters and derived quantities of a posterior: what they are called, and summary.csv."""

from __future__ import annotations

import numpy as np
import pandas as pd

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.posterior_content import PosteriorContent

SUMMARY_COLUMNS = (
    "symbol unit mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat contraction converged"
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

    contraction = 1 - var_posterior / var_prior, on the scale of the prior's
    normal coordinate for sampled parameters, on the logarithm (or the value,
    where it changes sign) for derived quantities and parts of a total.
    """
    target = content.target
    table = content.diagnostics.copy()
    attributes = labels(content, theta)
    table["converged"] = bool(content.convergence["converged"])
    table["symbol"] = [attributes[name]["symbol"] for name in table.index]
    table["unit"] = [attributes[name]["unit"] for name in table.index]
    z_variance = dict(
        zip(target.names, content.z.reshape(-1, target.dimension).var(0), strict=True)
    )
    for name in target.prior.parts:
        z_variance.pop(name)
    posterior, prior = quantities(target, theta), quantities(target, prior_theta)
    table["contraction"] = [
        1.0 - z_variance[name] if name in z_variance else contraction(posterior[name], prior[name])
        for name in table.index
    ]
    return table[list(SUMMARY_COLUMNS)]


def contraction(posterior: FloatArray, prior: FloatArray) -> float:
    """That of draws, on their logarithm where they are positive; tails do not count.

    The spread of either is half the distance of its 16 and 84 % quantiles.
    """
    prior = prior[np.isfinite(prior)]
    if np.all(posterior > 0) and np.all(prior > 0):
        posterior, prior = np.log(posterior), np.log(prior)
    after, before = (np.ptp(np.quantile(draws, [0.16, 0.84])) for draws in (posterior, prior))
    return float(1.0 - (after / max(before, 1e-300)) ** 2)


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
