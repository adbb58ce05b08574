"""From results to figures, the report, exports and populations."""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.files import write_atomically
from deabayes.pipeline.fit import stored_target
from deabayes.pipeline.judge import (
    analyse_study,
    check_as_fitted,
    compare_candidates,
    predict_candidate,
)

if TYPE_CHECKING:
    import xarray as xr

    from deabayes.experiment import FloatArray
    from deabayes.population.files import PopulationContent
    from deabayes.population.model import PopulationModel
    from deabayes.population.settings import Population
    from deabayes.population.specimens import Shrunken
    from deabayes.prior.joint import Prior
    from deabayes.report.notices import Notice
    from deabayes.sampling.engine import Sampled


def draw_figures(results: Path, output: Path, named: bool = False) -> None:
    """Draw every registered figure of a study; `named` writes its name into the drawings."""
    from deabayes.figures import save_all

    check_as_fitted(results)
    save_all(results, output, named)


def build_report(
    folders: Sequence[Path],
    output: Path,
    tables: Path,
    left_out: Sequence[str],
    failed: Sequence[Notice] = (),
) -> None:
    """Build the report page and its tables; `failed` lists jobs that failed."""
    from deabayes.report import build

    for folder in folders:
        check_as_fitted(folder)
    build(folders, output, tables, left_out, failed)


def export_posterior(
    posterior: Path, to: str, output: Path, **options: object
) -> tuple[bool, list[str]]:
    """Write a posterior in another program's format, which may take options.

    Returns whether the posterior converged, which not every format can store, and cautions.
    """
    from deabayes.export import export
    from deabayes.posteriors.storage import read_tree

    tree = read_tree(posterior)
    cautions = export(tree, to, output, **options)
    return bool(json.loads(tree.attrs["convergence"])["converged"]), cautions


WEIGHING_DRAWS = 1000
"""Of mean and spread, for the weights of a specimen's draws."""


def fit_population(population: Population, results: Path, output: Path, progress: bool) -> str:
    """Combine the posteriors of several specimens: posterior.nc, summary.csv, shrinkage.csv.

    Also predicts the response of a new specimen to the first member's records: predictions/,
    errors.csv.

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
    """Prior of all parameters of a fitted candidate."""
    return stored_target(tree, prepared)[1].prior


def content_of(
    population: Population,
    model: PopulationModel,
    pooled: Sampled,
    trees: Sequence[xr.DataTree],
    rng: np.random.Generator,
) -> PopulationContent:
    """Contents of a population's files, from the draws of mean and spread."""
    from deabayes.population.files import PopulationContent
    from deabayes.population.specimens import new_specimens, warnings_of
    from deabayes.posteriors.content import STORED_DRAWS
    from deabayes.posteriors.records import counted_records

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


FITTED = ("posterior.nc", "summary.csv", "scores.json", "errors.csv")
"""What a candidate must have to be shown."""
LONGEST_MESSAGE = 600


def finish(state: Path, output: Path, tables: Path) -> None:
    """Build the report of a run in which jobs failed.

    Parameters
    ----------
    state : JSON that the workflow writes: `failed` jobs (`stage`, `study`, `candidate`,
        `population`, `record`, `log`), the files `made` and up to date by results folder,
        `left_out` studies. Candidates that are complete are compared and drawn in a folder beside
        it.
    output, tables : the report's page and folder of tables.
    """
    content = json.loads(state.read_text(encoding="utf-8"))
    failed = [_notice(**job) for job in content["failed"]]
    folders = []
    for folder, files in content["made"].items():
        made = [Path(file) for file in files]
        if Path(folder, "figures") in made:
            folders.append(Path(folder))
            continue
        shown, missing = _shown_in_part(Path(folder), made, state.with_suffix(""))
        folders += shown
        known = {notice.study for notice in failed}
        failed += missing if Path(folder).name in known or shown else _not_run(Path(folder))
    build_report(folders, output, tables, content["left_out"], failed)


def _notice(
    stage: str, study: str, candidate: str, population: str, record: str, log: str
) -> Notice:
    """Notice of a failed job: the end of its log, and where the log is."""
    from deabayes.report.notices import Notice

    path = Path(log)
    said = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    lines = [line for line in said.replace("\r", "\n").splitlines() if line.strip()]
    details = (*(line[:LONGEST_MESSAGE] for line in lines[-1:]), f"log: {log}")
    return Notice(study or population, candidate, f"Failed: {stage} {record}".rstrip(), details)


def _not_run(folder: Path) -> list[Notice]:
    from deabayes.report.notices import Notice

    return [Notice(folder.name, "", "Not run", ("it needs results of what failed elsewhere",))]


def _shown_in_part(
    folder: Path, made: Sequence[Path], place: Path
) -> tuple[list[Path], list[Notice]]:
    """Results folder of the complete candidates, or None.

    Also returns a notice on each stage that could not run for them.
    """
    there = set(made)
    complete = [
        path.parent.name
        for path in made
        if path.name == FITTED[0] and there.issuperset(path.with_name(name) for name in FITTED)
    ]
    if not complete or folder / "study.yaml" not in there:
        return [], []
    shown = place / folder.name
    _link(folder, made, complete, shown)
    missing = list(_run_stages(shown, complete))
    drawn = (shown / "figures" / "index.json").is_file()
    return [shown] if drawn else [], missing


def _link(folder: Path, made: Iterable[Path], complete: Sequence[str], shown: Path) -> None:
    """Links to what is made of the complete candidates and of the study, and its settings."""
    from deabayes.studies import load_study, write_study

    shutil.rmtree(shown, ignore_errors=True)
    of_study = {"comparison.csv", "further_experiments.csv", "analyses"}
    for path in made:
        if path.parent.name in {*complete, "prepared"} or path.name in of_study:
            link = shown / path.relative_to(folder)
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(path.resolve())
    study = load_study(folder / "study.yaml")
    kept = tuple(name for name in study.candidates if name in complete)
    write_study(replace(study, candidates=kept), shown / "study.yaml")


def _run_stages(shown: Path, complete: Sequence[str]) -> Iterable[Notice]:
    """Run the stages that are missing in a study's folder; return a notice on each failure."""
    from deabayes.report.notices import Notice

    posteriors = [shown / name / FITTED[0] for name in complete]
    stages: dict[str, Callable[[Path], object]] = {
        "comparison.csv": lambda path: compare_candidates(posteriors, shown / "prepared", path),
        "analyses": lambda path: analyse_study(shown, path),
        "figures": lambda path: draw_figures(shown, path),
    }
    for name, run in stages.items():
        if not (shown / name).exists():
            try:
                run(shown / name)
            except Exception as error:
                said = f"{type(error).__name__}: {error}"
                yield Notice(shown.name, "", f"Not made: {name}", (said[:LONGEST_MESSAGE],))
