"""Commands from records to posteriors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from deabayes.cli.arguments import (
    CONFIG,
    EXISTING,
    RESULTS,
    TARGET,
    check_folder,
    check_folder_of,
    find_study,
    keep_inputs,
)
from deabayes.cli.records import checked
from deabayes.faults import UserError, nearest
from deabayes.study import Study, settings_on_file


@click.command()
@click.argument("study")
@CONFIG
@click.option("-o", "--output", type=TARGET, required=True, help="Folder for {experiment}.nc.")
@click.option("--record", help="Prepare this record alone; default: check the study, prepare all.")
def prepare(study: str, config: Path, output: Path, record: str | None) -> None:
    """Read and prepare the records of STUDY for inference."""
    prepare_by_name(study, config, output, record)


@click.command()
@click.argument("study")
@click.argument("candidate", required=False)
@CONFIG
@RESULTS
@click.option(
    "--preview", is_flag=True, help="Best fit of every candidate in seconds, without sampling."
)
@click.option("--prepared", type=EXISTING, help="Prepared records; default: prepare them first.")
@click.option(
    "-o", "--output", type=TARGET, help="Default: STUDY/CANDIDATE/posterior.nc, or STUDY/preview."
)
@click.option("--summary", type=TARGET, help="Default: summary.csv beside it.")
def fit(
    study: str,
    candidate: str | None,
    config: Path,
    results: Path,
    preview: bool,
    prepared: Path | None,
    output: Path | None,
    summary: Path | None,
) -> None:
    """Sample the posterior of CANDIDATE (voigt_kelvin_2, kv_gm_3, ...) in STUDY.

    All ensembles are run and judged together; the last line says whether they converged.
    Interrupt it at any time: the same command goes on where it stopped.

    With --preview and no CANDIDATE: the best fit of every candidate, with intervals from the
    curvature of the posterior and figures of data and fit. Look at them before you wait.
    """
    if preview:
        if candidate is not None or summary is not None:
            raise click.UsageError(
                "--preview fits every candidate into one folder; leave out CANDIDATE and --summary"
            )
        click.echo(preview_by_name(study, config, results, prepared, output))
        return
    if candidate is None:
        raise click.UsageError("Missing argument 'CANDIDATE'; or add --preview to fit every one.")
    click.echo(fit_by_name(study, candidate, config, results, prepared, output, summary))


def prepare_by_name(study: str, config: Path, output: Path, record: str | None = None) -> None:
    """Check one study and prepare its records; or prepare one record, without the study's check."""
    from deabayes.pipeline import prepare_record, prepare_study

    check_folder(output)
    found = find_study(study, config)
    if record is None:
        checked(found)
    keep_inputs(output, *_folders_of(found))
    if record is None:
        prepare_study(found, output)
    else:
        prepare_record(found, record, output)


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
    them for `deabayes analyse`. With `prepared`, held-out records are not checked: the fit does not
    use them.
    """
    from deabayes.api import open_posterior
    from deabayes.pipeline import fit_candidate

    found = find_study(study, config)
    _known(found, candidate)
    output = output or results / found.name / candidate / "posterior.nc"
    summary = summary or output.with_name("summary.csv")
    keep_inputs(output, Path(study), config, prepared)
    keep_inputs(summary, Path(study), config, prepared, option="--summary")
    if prepared is not None:
        checked(replace(found, candidates=(candidate,), validate=()))
    else:
        prepared = _prepared(found, results)
    fit_candidate(found, candidate, prepared, output, summary, progress=True)
    posterior = open_posterior(output)
    verdict = "converged" if posterior.converged else "NOT converged"
    return "\n".join([*posterior.leaning, f"{output}: {verdict}; parameters in {summary}"])


def preview_by_name(
    study: str, config: Path, results: Path, prepared: Path | None, output: Path | None
) -> str:
    """Preview every candidate of a study; return a short table.

    Without `prepared`, the study is checked and its records are prepared first.
    """
    from deabayes.pipeline.preview import FOLDER, in_words, preview_study

    found = find_study(study, config)
    output = output or results / found.name / FOLDER
    check_folder_of("previews", output, "doubts", replaced=True)
    keep_inputs(output, prepared)
    previews = preview_study(found, prepared or _prepared(found, results), output)
    return "\n".join(in_words(found, previews, output))


def _prepared(study: Study, results: Path) -> Path:
    """Check a study, prepare its records, and return their folder."""
    from deabayes.pipeline import prepare_study

    checked(study)
    prepared = results / study.name / "prepared"
    _keep_settings(study, results / study.name / "study.yaml")
    prepare_study(study, prepared)
    return prepared


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
