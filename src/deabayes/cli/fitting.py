"""Commands from records to posteriors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from deabayes.cli.arguments import (
    CONFIG,
    EXISTING,
    RESULTS,
    TARGET,
    check_folder,
    find_study,
    keep_inputs,
)
from deabayes.cli.records import checked
from deabayes.faults import UserError, nearest
from deabayes.study import Study, settings_on_file

if TYPE_CHECKING:
    from deabayes.experiment import Experiment
    from deabayes.inference.log_posterior import LogPosterior


@click.command()
@click.argument("study")
@CONFIG
@click.option("-o", "--output", type=TARGET, required=True, help="Folder for {experiment}.nc.")
def prepare(study: str, config: Path, output: Path) -> None:
    """Read and prepare the records of STUDY for inference."""
    prepare_by_name(study, config, output)


@click.command(name="compile")
@click.argument("study")
@CONFIG
def compile_kernels(study: str, config: Path) -> None:
    """Compile what STUDY needs, once, into numba's cache on disk.

    STUDY is a settings file with the prepared records beside it. Another study of the same
    system waits until this one is compiled.
    """

    compile_study(study, config)


@click.command()
@click.argument("study")
@click.argument("candidate")
@CONFIG
@RESULTS
@click.option("--prepared", type=EXISTING, help="Prepared records; default: prepare them first.")
@click.option("-o", "--output", type=TARGET, help="Default: STUDY/CANDIDATE/posterior.nc.")
@click.option("--summary", type=TARGET, help="Default: summary.csv beside it.")
def fit(
    study: str,
    candidate: str,
    config: Path,
    results: Path,
    prepared: Path | None,
    output: Path | None,
    summary: Path | None,
) -> None:
    """Sample the posterior of CANDIDATE (voigt_kelvin_2, kv_gm_3, ...) in STUDY.

    All ensembles are run and judged together; the last line says whether they converged.
    Interrupt it at any time: the same command goes on where it stopped.
    """
    click.echo(fit_by_name(study, candidate, config, results, prepared, output, summary))


TRIAL_WALKERS = 2


def compile_study(study: str, config: Path) -> None:
    """Call every kernel of each candidate once, so that numba's cache holds them.

    Studies of one system are compiled one after the other, so that the second finds the kernels of
    the first. The posterior that `prior_from` names need not exist yet.
    """
    from deabayes.integrate.compiled import one_at_a_time
    from deabayes.pipeline import build_target, read_experiments
    from deabayes.records.specimen import read_specimen

    found = replace(find_study(study, config), prior_from=None)
    prepared = Path(study).parent / "prepared"
    experiments = read_experiments(prepared)
    with one_at_a_time(f"compile_{read_specimen(found.specimen).system}"):
        for candidate in found.candidates:
            target = build_target(found, candidate, prepared)
            _use_every_kernel(target, experiments)
            _use_wider_systems(found, target, experiments)
        _use_the_proposal()


def _use_the_proposal() -> None:
    """Compile the sampler's straightening map and its inverse."""
    import numpy as np

    from deabayes.sampling.warp import fit_warp

    samples = np.random.default_rng(0).standard_normal((200, 2))
    warp = fit_warp(samples)
    assert warp is not None
    warp.inverse(warp.forward(samples))


def _use_wider_systems(
    study: Study, target: LogPosterior, experiments: Sequence[Experiment]
) -> None:
    """Compile the models that `predict_with` names, at the median of the prior."""
    import numpy as np

    from deabayes.inference.default_priors import further_prior, wider_systems

    theta = target.prior.to_parameters(np.zeros((TRIAL_WALKERS, target.dimension)))
    draws = dict(target.draws(theta))
    further = further_prior(study, target.system, target.names)
    if further is not None:
        theta = further.to_parameters(np.zeros((TRIAL_WALKERS, len(further.names))))
        draws |= dict(zip(further.names, np.ascontiguousarray(theta.T), strict=True))
    for protocol, system in wider_systems(study, target.system).items():
        for each in experiments:
            if each.protocol == protocol:
                system.simulator_of(each)(draws)


def _use_every_kernel(target: LogPosterior, experiments: Sequence[Experiment]) -> None:
    """Compile likelihood, derived quantities, responses, noise and innovations."""
    import numpy as np

    theta = target.prior.to_parameters(np.zeros((TRIAL_WALKERS, target.dimension)))
    draws = target.draws(theta)
    target.log_likelihood(theta)
    target.pointwise_log_likelihood(theta)
    target.system.derived(draws)
    for each in experiments:
        target.system.simulator_of(each)(draws)
    record, random = target.records[0], np.random.default_rng(0)
    coordinate, noise_draws = record.experiment.coordinate, target.noise_draws(draws, record.group)
    correlated, white = target.noise.sample(random, coordinate, record.weights, noise_draws)
    target.noise.innovations(correlated + white, coordinate, record.weights, noise_draws)


def prepare_by_name(study: str, config: Path, output: Path) -> None:
    """Check one study and prepare its records."""
    from deabayes.pipeline import prepare_study

    check_folder(output)
    found = find_study(study, config)
    checked(found)
    keep_inputs(output, *_folders_of(found))
    prepare_study(found, output)


def fit_by_name(
    study: str,
    candidate: str,
    config: Path,
    results: Path,
    prepared: Path | None = None,
    output: Path | None = None,
    summary: Path | None = None,
) -> str:
    """Sample the posterior of a candidate; return a sentence on convergence.

    Without `prepared`, the records are prepared first. The study's settings are written beside
    them for `deabayes analyse`.
    """
    from deabayes.api import open_posterior
    from deabayes.pipeline import fit_candidate, prepare_study

    found = find_study(study, config)
    _known(found, candidate)
    output = output or results / found.name / candidate / "posterior.nc"
    summary = summary or output.with_name("summary.csv")
    keep_inputs(output, Path(study), config, prepared)
    keep_inputs(summary, Path(study), config, prepared, option="--summary")
    if prepared is None:
        checked(found)
        prepared = results / found.name / "prepared"
        _keep_settings(found, results / found.name / "study.yaml")
        prepare_study(found, prepared)
    fit_candidate(found, candidate, prepared, output, summary, progress=True)
    posterior = open_posterior(output)
    verdict = "converged" if posterior.converged else "NOT converged"
    return "\n".join([*posterior.leaning, f"{output}: {verdict}; parameters in {summary}"])


def _folders_of(study: Study) -> list[Path]:
    """Folders of a study's tables and records."""
    from deabayes.records.folder import read_folder

    read = read_folder(study.specimen, study.data_root, check_records=False)
    files = [path for row in read.table if (path := read.locate(row)) is not None]
    return [study.specimen, *dict.fromkeys(path.parent for path in files)]


def _keep_settings(study: Study, path: Path) -> None:
    """Write study.yaml unless it is the same: a newer file would start `prepare` again."""
    from deabayes.studies import load_study, write_study

    if not path.is_file() or settings_on_file(load_study(path)) != settings_on_file(study):
        write_study(study, path)


def _known(study: Study, candidate: str) -> str:
    if candidate not in study.candidates:
        raise UserError(
            f"study {study.name} has no candidate {candidate!r}"
            f"{nearest(candidate, study.candidates)}"
        )
    return candidate
