"""What goes into a posterior file: draws, derived quantities, prior, data, provenance."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

import deabayes
from deabayes.experiment import FloatArray, Specimen
from deabayes.fitted import CalibratedRecord, records_to_json
from deabayes.pooling import PooledResult
from deabayes.posterior import LogPosterior
from deabayes.storage import specimen_to_json
from deabayes.study import Study, to_settings

PRIOR_DRAWS = 1000
STORED_DRAWS = 2000
PRIOR_PREDICTIVE_DRAWS = 50
SUMMARY_COLUMNS = (
    "symbol unit mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat contraction converged"
).split()


@dataclass(frozen=True)
class PosteriorContent:
    """The pieces of a posterior file.

    `z` (E, S, d) are thinned draws of the E independent ensembles in the
    prior's standard-normal coordinate, `log_posterior` (E, S) their density;
    `diagnostics` is indexed by quantity; `convergence` says in words what failed.
    """

    study: Study
    candidate: str
    specimen: Specimen
    target: LogPosterior
    z: FloatArray
    log_posterior: FloatArray
    diagnostics: pd.DataFrame
    convergence: Mapping[str, object]
    warnings: Sequence[str]
    seed: np.random.SeedSequence

    @classmethod
    def of(
        cls,
        study: Study,
        candidate: str,
        target: LogPosterior,
        pooled: PooledResult,
        seed: np.random.SeedSequence,
    ) -> PosteriorContent:
        """Thin the pooled draws to at most `STORED_DRAWS` per ensemble, spread over time."""
        ensembles, steps, walkers, dimension = pooled.chain.shape
        picked = np.linspace(0, steps * walkers - 1, min(STORED_DRAWS, steps * walkers)).astype(int)
        z = pooled.chain.reshape(ensembles, -1, dimension)[:, picked]
        experiments = [record.experiment for record in target.records]
        return cls(
            study,
            candidate,
            target.system.specimen,
            target,
            z,
            pooled.log_posterior.reshape(ensembles, -1)[:, picked],
            pooled.convergence.table,
            convergence_summary(pooled),
            [f"{e.name}: {warning}" for e in experiments for warning in e.warnings],
            seed,
        )


def convergence_summary(pooled: PooledResult) -> dict[str, object]:
    """What a reader needs to know of how the draws were made."""
    convergence, runs = pooled.convergence, pooled.ensembles
    table = convergence.table
    shares = convergence.mode_shares
    return {
        "converged": bool(convergence.converged),
        "reasons": list(convergence.reasons),
        "r_hat_max": float(table["r_hat"].max()),
        "ess_bulk_min": float(table["ess_bulk"].min()),
        "ess_tail_min": float(table["ess_tail"].min()),
        "autocorrelation_times_min": float(np.min(convergence.autocorrelation_times)),
        "tau_max": max(float(run.autocorrelation_time) for run in runs),
        "steps": max(run.steps for run in runs),
        "walkers": int(pooled.chain.shape[2]),
        "ensembles": len(runs),
        "acceptance": float(np.mean([run.acceptance for run in runs])),
        "refitted": any(run.refitted for run in runs),
        "replaced_walkers": sum(run.replaced_walkers for run in runs),
        "failures": {
            "evaluations": sum(run.evaluations for run in runs),
            "failed": sum(run.failures for run in runs),
        },
        "mode_shares": [] if shares is None else shares.to_numpy().tolist(),
    }


def posterior_tree(content: PosteriorContent) -> xr.DataTree:
    """The ArviZ DataTree of a fitted candidate (groups as in interface.md, Results)."""
    theta = content.target.prior.to_parameters(content.z.reshape(-1, content.z.shape[2]))
    prior_theta = content.target.prior.sample(np.random.default_rng(content.seed), PRIOR_DRAWS)
    summary = summary_table(content, theta, prior_theta)
    groups = {
        "posterior": _draws(content, theta, content.z.shape[:2]),
        "sample_stats": xr.Dataset({"lp": (("chain", "draw"), content.log_posterior)}),
        "unconstrained_posterior": xr.Dataset({"z": (("chain", "draw", "dimension"), content.z)}),
        "log_likelihood": _log_likelihood(content, theta),
        "log_prior": xr.Dataset(
            {
                "log_prior": (
                    ("chain", "draw"),
                    content.target.prior.log_density(theta).reshape(content.z.shape[:2]),
                )
            }
        ),
        "prior": _draws(content, prior_theta, (1, PRIOR_DRAWS)),
        "prior_predictive": _prior_predictive(content, prior_theta[:PRIOR_PREDICTIVE_DRAWS]),
        "observed_data": _observed(content),
        "summary": xr.Dataset(
            {name: ("quantity", summary[name].to_numpy()) for name in SUMMARY_COLUMNS},
            coords={"quantity": list(summary.index)},
        ),
    }
    tree = xr.DataTree.from_dict(groups)
    tree.attrs.update(_attributes(content))
    return tree


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
    where it changes sign) for derived quantities.
    """
    target = content.target
    table = content.diagnostics.copy()
    attributes = _labels(content, theta)
    table["converged"] = bool(content.convergence["converged"])
    table["symbol"] = [attributes[name]["symbol"] for name in table.index]
    table["unit"] = [attributes[name]["unit"] for name in table.index]
    z_variance = dict(
        zip(target.names, content.z.reshape(-1, target.dimension).var(0), strict=True)
    )
    posterior, prior = quantities(target, theta), quantities(target, prior_theta)
    table["contraction"] = [
        1.0 - z_variance[name] if name in z_variance else _contraction(posterior[name], prior[name])
        for name in table.index
    ]
    return table[list(SUMMARY_COLUMNS)]


def _contraction(posterior: FloatArray, prior: FloatArray) -> float:
    prior = prior[np.isfinite(prior)]
    if np.all(posterior > 0) and np.all(prior > 0):
        posterior, prior = np.log(posterior), np.log(prior)
    low, high = np.quantile(prior, [0.16, 0.84])
    return float(1.0 - np.var(posterior) / max((high - low) / 2.0, 1e-300) ** 2)


def _labels(content: PosteriorContent, theta: FloatArray) -> dict[str, dict[str, str]]:
    target = content.target
    quantity_names = set(content.specimen.quantities)
    labels = {
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
        labels[name] = {
            "symbol": d.symbol,
            "unit": d.unit,
            "description": d.description,
            "prior": "",
            "kind": "derived",
        }
    return labels


def _draws(content: PosteriorContent, theta: FloatArray, shape: tuple[int, int]) -> xr.Dataset:
    labels = _labels(content, theta)
    return xr.Dataset(
        {
            name: (("chain", "draw"), values.reshape(shape), labels[name])
            for name, values in quantities(content.target, theta).items()
        },
        coords={"chain": np.arange(shape[0]), "draw": np.arange(shape[1])},
    )


def _log_likelihood(content: PosteriorContent, theta: FloatArray) -> xr.Dataset:
    shape = content.z.shape[:2]
    terms = {
        name: (("chain", "draw"), content.target.log_likelihood(theta, [name]).reshape(shape))
        for name in (record.experiment.name for record in content.target.records)
    }
    return xr.Dataset(terms)


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
    responses = content.target.responses(theta)
    observed = _observed(content)
    return xr.Dataset(
        {
            name: (("chain", "draw", f"{name}_coordinate"), values[None])
            for name, values in responses.items()
        },
        coords=observed.coords,
    )


def _attributes(content: PosteriorContent) -> dict[str, str]:
    target, study = content.target, content.study
    records = [CalibratedRecord.of(r.experiment, r.group, r.scale) for r in target.records]
    return {
        "study": json.dumps(to_settings(study)),
        "study_name": study.name,
        "candidate": content.candidate,
        "order": str(target.system.order),
        "system": content.specimen.system,
        "specimen": specimen_to_json(content.specimen),
        "provenance": content.specimen.provenance.get("kind", "measured"),
        "noise": study.noise,
        "experiments": records_to_json(records),
        "convergence": json.dumps(content.convergence),
        "warnings": json.dumps(list(content.warnings)),
        "deabayes_version": deabayes.__version__,
    }
