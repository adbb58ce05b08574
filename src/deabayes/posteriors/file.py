"""What goes into a posterior file: draws, derived quantities, prior, data, provenance."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

import deabayes
from deabayes.experiment import FloatArray
from deabayes.own_models.loading import recorded
from deabayes.posteriors.content import PosteriorContent
from deabayes.posteriors.counted_records import ATTRIBUTE, CountedRecord, to_json
from deabayes.posteriors.inherited_prior import GROUP, inherited_prior
from deabayes.posteriors.storage import specimen_to_json
from deabayes.posteriors.summary import SUMMARY_COLUMNS, labels, quantities, summary_table
from deabayes.prediction.noise_origin import CalibratedRecord, records_to_json
from deabayes.study import to_settings

PRIOR_DRAWS = 1000
COMPARED_PRIOR_DRAWS = 10_000
"""With which the posterior's widths are compared: their contraction scatters by 0.02."""
PRIOR_PREDICTIVE_DRAWS = 50


def posterior_tree(content: PosteriorContent) -> xr.DataTree:
    """The ArviZ DataTree of a fitted candidate (groups as in interface.md, Results)."""
    theta = content.target.prior.to_parameters(content.z.reshape(-1, content.z.shape[2]))
    rng = np.random.default_rng(content.seed)
    prior_theta = content.target.prior.sample(rng, COMPARED_PRIOR_DRAWS)
    summary = summary_table(content, theta, prior_theta)
    prior_theta = prior_theta[:PRIOR_DRAWS]
    groups = {
        "posterior": _draws(content, theta, content.z.shape[:2]).merge(_further(content)),
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
        coords={"chain": np.arange(shape[0]), "draw": np.arange(shape[1])},
    )


def _further(content: PosteriorContent) -> xr.Dataset:
    """Draws of what no fitted record tells of: those of its prior."""
    if content.further is None:
        return xr.Dataset()
    shape = content.z.shape[:2]
    seed = np.random.SeedSequence(content.seed.entropy, spawn_key=(*content.seed.spawn_key, 1))
    theta = content.further.sample(np.random.default_rng(seed), int(np.prod(shape)))
    return xr.Dataset(
        {
            p.name: (
                ("chain", "draw"),
                column.reshape(shape),
                {
                    "symbol": p.symbol,
                    "unit": p.unit,
                    "description": f"{p.description}; not fitted, drawn from its prior",
                    "prior": content.further.describe(p.name),
                    "kind": "prior",
                },
            )
            for p, column in zip(content.further.parameters, theta.T, strict=True)
        }
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
