"""From the posteriors of several specimens to the population they are of."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.files import write_atomically
from deabayes.pipeline.identify import stored_target
from deabayes.pipeline.judge import predict_candidate

if TYPE_CHECKING:
    import xarray as xr

    from deabayes.experiment import FloatArray
    from deabayes.population.files import PopulationContent
    from deabayes.population.model import PopulationModel
    from deabayes.population.settings import Population
    from deabayes.population.specimens import Shrunken
    from deabayes.prior.joint import Prior
    from deabayes.sampling.engine import Sampled

WEIGHING_DRAWS = 1000
"""Of mean and spread, for the weights of a specimen's draws."""


def fit_population(population: Population, results: Path, output: Path, progress: bool) -> str:
    """Put the specimens' posteriors together: posterior.nc, summary.csv, shrinkage.csv.

    And a new specimen's response to the records of the first member: predictions/, errors.csv.

    Parameters
    ----------
    results : of the studies, `{results}/{study}/{candidate}/posterior.nc` and `prepared`.
    output : folder of the population.

    Returns
    -------
    str
        A sentence on convergence, and what a reader must know.
    """
    from deabayes.population.files import population_tree, shrinkage_table, summary_table
    from deabayes.population.member import read_members
    from deabayes.population.model import PopulationModel, sample
    from deabayes.posteriors.storage import read_tree, write_tree

    folders = [results / study for study in population.studies]
    trees = [read_tree(folder / population.candidate / "posterior.nc") for folder in folders]
    priors = [
        prior_of(tree, folder / "prepared") for tree, folder in zip(trees, folders, strict=True)
    ]
    coordinate, members = read_members(population.studies, trees, priors, population.parameters)
    model = PopulationModel.of(coordinate, members, population.spread)
    seed = np.random.SeedSequence([population.sampling.seed, zlib.crc32(population.name.encode())])
    sampling_seed, later = seed.spawn(2)
    pooled = sample(model, population.sampling, sampling_seed, progress)
    content = content_of(population, model, pooled, trees, np.random.default_rng(later))
    summary, shrinkage = summary_table(content), shrinkage_table(content)
    write_tree(population_tree(content), output / "posterior.nc")
    write_atomically(lambda path: summary.to_csv(path), output / "summary.csv")
    write_atomically(lambda path: shrinkage.to_csv(path, index=False), output / "shrinkage.csv")
    failures = predict_candidate(
        output / "posterior.nc",
        folders[0] / "prepared",
        output / "predictions",
        output / "errors.csv",
    )
    return _said(content, output, failures)


def prior_of(tree: xr.DataTree, prepared: Path) -> Prior:
    """The prior of all parameters of a fitted candidate, as its study gives it."""
    return stored_target(tree, prepared)[1].prior


def content_of(
    population: Population,
    model: PopulationModel,
    pooled: Sampled,
    trees: Sequence[xr.DataTree],
    rng: np.random.Generator,
) -> PopulationContent:
    """All that follows from the draws of mean and spread."""
    from deabayes.population.files import PopulationContent
    from deabayes.population.specimens import new_specimens, warnings_of
    from deabayes.posteriors.content import STORED_DRAWS
    from deabayes.posteriors.counted_records import counted_records

    z, log_posterior = pooled.thinned(STORED_DRAWS)
    shape = z.shape[:2]
    z = z.reshape(-1, z.shape[2])
    theta = model.prior.to_parameters(z)
    centres, spreads = model.split(theta)
    new, outside = new_specimens(model, centres, spreads, rng)
    shrunken = _shrunken(model, z, rng)
    rows = rng.choice(len(model.members[0].phi), len(theta), p=shrunken[0].weights)
    return PopulationContent(
        population,
        model,
        pooled,
        theta.reshape(*shape, -1),
        log_posterior,
        new.reshape(*shape, -1),
        shrunken,
        warnings_of(model, shrunken, outside),
        trees[0],
        rows,
        [record for tree in trees for record in counted_records(tree)],
    )


def _shrunken(model: PopulationModel, z: FloatArray, rng: np.random.Generator) -> list[Shrunken]:
    from deabayes.population.specimens import shrink, without

    some = rng.choice(z, min(WEIGHING_DRAWS, len(z)), replace=False)
    draws = model.split(model.prior.to_parameters(some))
    return [
        shrink(model, index, *draws, without(model, index, some, rng))
        for index in range(len(model.members))
    ]


def _said(content: PopulationContent, output: Path, failures: Sequence[str]) -> str:
    convergence = content.convergence
    verdict = "converged" if convergence["converged"] else "NOT converged"
    reasons = convergence["reasons"]
    lines = [*reasons, *content.warnings, *failures] if isinstance(reasons, list) else []
    return "\n".join([f"{output / 'posterior.nc'}: {verdict}", *(f"  - {line}" for line in lines)])
