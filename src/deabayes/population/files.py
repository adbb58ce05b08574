"""Results of a population: posterior file, summary table, shrinkage table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import deabayes
from deabayes.experiment import FloatArray
from deabayes.population.model import PopulationModel
from deabayes.population.settings import Population, to_settings
from deabayes.population.specimens import Shrunken
from deabayes.posteriors.content import convergence_summary
from deabayes.posteriors.file import label, summary_dataset
from deabayes.posteriors.records import ATTRIBUTE, CountedRecord, to_json
from deabayes.sampling.diagnostics import summarise
from deabayes.sampling.engine import Sampled

HANDED_ON = ("study", "specimen", "noise", "experiments", "system", "order")
"""Attributes copied from the first member's file, since a new specimen is predicted like it."""
QUANTILES = {"median": 0.5, "q05": 0.05, "q95": 0.95}
REFERENCE = "reference"
"""Kind of parameters copied from the first member; no other study takes them over as a prior."""


@dataclass(frozen=True)
class PopulationContent:
    """Draws of a population, with all that its files state about them.

    `theta` (E, S, 2 d) are means and spreads. `new` (E, S, d) are the parameters of a new
    specimen. `rows` (E S,) are the draws of the first member that supply the new specimen's other
    parameters. `counted` are the records that any member has used.
    """

    population: Population
    model: PopulationModel
    pooled: Sampled
    theta: FloatArray
    log_posterior: FloatArray
    new: FloatArray
    shrunken: Sequence[Shrunken]
    warnings: Sequence[str]
    first: xr.DataTree
    rows: NDArray[np.intp]
    counted: Sequence[CountedRecord] = ()

    @property
    def convergence(self) -> dict[str, object]:
        """Convergence as for a candidate; the population needs every member to have converged."""
        summary = convergence_summary(self.pooled)
        lost = [member.study for member in self.model.members if not member.converged]
        reasons = [f"{name}: its own posterior has not converged" for name in lost]
        failed = [replace(f, of=f"population, {f.of}") for f in self.pooled.convergence.failed]
        reasons += [str(gate) for gate in failed]
        gates = [asdict(gate) for gate in failed]
        return summary | {"converged": not reasons, "reasons": reasons, "failed_gates": gates}


def population_tree(content: PopulationContent) -> xr.DataTree:
    """Build the DataTree of a population, which is the posterior file of a new specimen.

    The group `posterior` holds the new specimen's parameters, the population's means and spreads
    (kind `population`), and the first member's other parameters, which predictions need (kind
    `reference`).
    """
    model, chains = content.model, content.theta.shape[:2]
    dimensions = ("chain", "draw")
    group = content.first["posterior"]
    names = model.coordinate.names
    variables = {
        name: (dimensions, content.new[..., k], _new_label(group[name].attrs, content))
        for k, name in enumerate(names)
    }
    for k, p in enumerate(model.prior.parameters):
        attributes = label(p, model.prior.describe(p.name), "population")
        variables[p.name] = (dimensions, content.theta[..., k], attributes)
    for name, variable in group.data_vars.items():
        if name not in names and variable.attrs["kind"] != "derived":
            values = variable.values.reshape(-1)[content.rows].reshape(chains)
            variables[str(name)] = (dimensions, values, variable.attrs | {"kind": REFERENCE})
    coordinates = {"chain": np.arange(chains[0]), "draw": np.arange(chains[1])}
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(variables, coords=coordinates),
            "sample_stats": xr.Dataset({"lp": (dimensions, content.log_posterior)}),
            "summary": summary_dataset(summary_table(content)),
            "specimens": _specimens(content),
        }
    )
    tree.attrs.update(_attributes(content))
    return tree


def _new_label(attributes: Mapping[str, str], content: PopulationContent) -> dict[str, str]:
    own = {key: str(attributes[key]) for key in ("symbol", "unit", "kind")}
    size = len(content.model.members)
    return own | {
        "description": f"{attributes['description']}, of a new specimen",
        "prior": f"population of {size} specimens ({content.population.name})",
    }


def _specimens(content: PopulationContent) -> xr.Dataset:
    """Draws of every member with the population as prior, in SI."""
    model, rng = content.model, np.random.default_rng(content.population.sampling.seed)
    drawn = np.stack(
        [
            model.coordinate.inverse(member.phi[rng.choice(len(member.phi), 1000, p=own.weights)])
            for member, own in zip(model.members, content.shrunken, strict=True)
        ]
    )
    return xr.Dataset(
        {
            p.name: (("specimen", "sample"), drawn[..., k], {"unit": p.unit, "symbol": p.symbol})
            for k, p in enumerate(model.coordinate.parameters)
        },
        coords={"specimen": [member.study for member in model.members]},
    )


def _attributes(content: PopulationContent) -> dict[str, str]:
    first, members = content.first.attrs, content.model.members
    simulated = any(member.provenance == "simulated" for member in members)
    handed_on = {key: first[key] for key in first if key in HANDED_ON or key.startswith("model")}
    return handed_on | {
        "population": json.dumps(to_settings(content.population)),
        "study_name": content.population.name,
        "candidate": content.population.candidate,
        "provenance": "simulated" if simulated else members[0].provenance,
        "convergence": json.dumps(content.convergence),
        "warnings": json.dumps(list(content.warnings)),
        "deabayes_version": deabayes.__version__,
        ATTRIBUTE: to_json(content.counted),
    }


def summary_table(content: PopulationContent) -> pd.DataFrame:
    """Return the table of summary.csv: a new specimen's parameters, then means and spreads."""
    model = content.model
    new = {name: content.new[..., k, None] for k, name in enumerate(model.coordinate.names)}
    parameters = [*model.coordinate.parameters, *model.prior.parameters]
    table = pd.concat([summarise(new), content.pooled.convergence.table])
    table.insert(0, "unit", [p.unit for p in parameters])
    table.insert(0, "symbol", [p.symbol for p in parameters])
    table["converged"] = bool(content.convergence["converged"])
    return table.rename_axis("parameter")


def shrinkage_table(content: PopulationContent) -> pd.DataFrame:
    """Return the table of shrinkage.csv: estimates of specimens without and with the population.

    Values are in SI.
    """
    rows = []
    coordinate = content.model.coordinate
    for member, estimate in zip(content.model.members, content.shrunken, strict=True):
        theta = coordinate.inverse(member.phi)
        for k, p in enumerate(coordinate.parameters):
            own = np.quantile(theta[:, k], list(QUANTILES.values()))
            pulled = weighted_quantiles(theta[:, k], estimate.weights, list(QUANTILES.values()))
            rows.append(
                {
                    "study": member.study,
                    "parameter": p.name,
                    "symbol": p.symbol,
                    "unit": p.unit,
                    **dict(zip(QUANTILES, own, strict=True)),
                    **{f"shrunken_{q}": v for q, v in zip(QUANTILES, pulled, strict=True)},
                    "shrinkage": estimate.shrinkage[k],
                    "tail_probability": estimate.tail_probability[k],
                    "effective_draws": estimate.effective_draws,
                    "k_hat": estimate.k_hat,
                    "misfit": member.likelihood.misfit,
                    "reliable": estimate.reliable,
                    "converged": member.converged,
                    "provenance": member.provenance,
                }
            )
    return pd.DataFrame(rows)


def weighted_quantiles(
    values: FloatArray, weights: FloatArray, probabilities: Sequence[float]
) -> FloatArray:
    """Quantiles of draws (K,) with weights (K,) that sum to one."""
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.asarray(np.interp(probabilities, cumulative, values[order]))
