"""Stages run by hand: studies by name, default places, several stages in a row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from deabayes.cli.arguments import a_folder, find_study, found_posteriors, keep_inputs
from deabayes.cli.records import checked
from deabayes.cli.using import named, once_each, read_drive
from deabayes.faults import UserError, nearest
from deabayes.studies import load_study, write_study
from deabayes.study import Study, settings_on_file
from deabayes.units import NUMBER_AND_UNIT

OTHER_FORMATS = (".xlsx", ".xls", ".nc", ".mat", ".tdms", ".json", ".parquet")
"""Endings that a CSV file may not have: what opens them would not read it."""


def new_by_name(name: str, system: str, folder: Path, config: Path) -> str:
    """Write a study folder to fill in; the entry for the config."""
    from deabayes.own_models.loading import load_for
    from deabayes.records.scaffold import new_study

    load_for(system, config)
    return new_study(name, system, folder)


def prepare_by_name(study: str, config: Path, output: Path) -> None:
    """Prepare the records of one study, if all that it asks for can be given."""
    from deabayes.pipeline import prepare_study

    a_folder(output)
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
    """Sample the posterior of a candidate; a sentence on convergence.

    Without `prepared` the records are prepared first, and the study's settings are written beside
    them, for `deabayes analyse`.
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


def compare_posteriors(
    sources: Sequence[str], results: Path, prepared: Path | None, output: Path | None
) -> str:
    """Score the posteriors that have no score yet, rank them; the table as text."""
    from deabayes.pipeline import compare_candidates, score_candidate

    posteriors = found_posteriors(sources, results)
    prepared = prepared or posteriors[0].parent.parent / "prepared"
    output = output or posteriors[0].parent.parent / "comparison.csv"
    keep_inputs(output, prepared, *posteriors, *(p.with_name("scores.json") for p in posteriors))
    for posterior in posteriors:
        scores = posterior.with_name("scores.json")
        if not scores.exists() or scores.stat().st_mtime < posterior.stat().st_mtime:
            score_candidate(posterior, prepared, scores)
    compare_candidates(posteriors, prepared, output)
    return output.read_text()


def weigh_experiments(results: Path, config: Path, asked: str | None, output: Path | None) -> str:
    """Weigh experiments that could be done next; the table as text.

    Parameters
    ----------
    asked : `further_experiments` as YAML; by default those of the study that `results` is of.
    """
    from deabayes.pipeline import entries_of, further_experiments

    if asked is None:
        entries = find_study(results.resolve().name, config).further_experiments
    else:
        entries = entries_of(asked)
    output = output or results / "further_experiments.csv"
    keep_inputs(output, config, results / "study.yaml", results / "comparison.csv")
    further_experiments(results, entries, output)
    return output.read_text()


def predict_posteriors(
    source: str, results: Path, prepared: Path | None, output: Path | None, errors: Path | None
) -> str:
    """Predict with one posterior, or with every posterior of a study; where the tables are."""
    from deabayes.pipeline import predict_candidate

    posteriors = found_posteriors([source], results)
    if len(posteriors) > 1 and (output or errors):
        raise UserError("--output and --errors go with one posterior file, not with a study")
    lines = []
    for posterior in posteriors:
        table = errors or posterior.with_name("errors.csv")
        records = prepared or posterior.parent.parent / "prepared"
        keep_inputs(output, posterior, records)
        keep_inputs(errors, posterior, records, option="--errors")
        lines += predict_candidate(
            posterior,
            records,
            output or posterior.with_name("predictions"),
            table,
        )
        lines.append(f"{table}")
    return "\n".join(lines)


def simulate_record(
    system: str,
    candidate: str,
    specimen: Path,
    excitation: Path,
    settings: Sequence[str],
    conditions: Sequence[str],
    output: Path,
    config: Path,
) -> str:
    """Simulate the response to the drive in a record; write time, drive and response as CSV.

    Returns why the response ends or is missing, empty where it is whole.
    """
    from deabayes.files import write_atomically
    from deabayes.own_models.loading import load_for
    from deabayes.prediction.simulate import simulate

    if output.suffix.lower() in OTHER_FORMATS:
        raise UserError(f"-o {output}: a table is written, name it .csv")
    load_for(system, config)
    driven: dict[str, Any] = read_drive(system, excitation)
    response = simulate(
        system,
        candidate,
        parameters=dict(_values(settings)),
        specimen=specimen,
        conditions=dict(named(conditions, "--condition")),
        **driven,
    )
    table = response.to_dataframe().reset_index()
    table.columns = [f"{name} [{response[name].attrs['units']}]" for name in table.columns]
    write_atomically(lambda path: table.to_csv(path, index=False), output)
    return str(response.attrs.get("failure", ""))


def download(studies: Sequence[str], config: Path) -> Iterator[str]:
    """Fetch the public records of the studies; one line per specimen folder."""
    from deabayes.records.download import fetch
    from deabayes.studies import load_studies

    wanted = [find_study(name, config) for name in studies] or load_studies(config)
    for folder, root in dict.fromkeys((study.specimen, study.data_root) for study in wanted):
        place = fetch(folder, root, progress=True)
        if place != folder:
            yield f"{folder}: records are in {place}"


def _folders_of(study: Study) -> list[Path]:
    """Where a study's tables and its records are."""
    from deabayes.records.folder import read_folder

    read = read_folder(study.specimen, study.data_root, check_records=False)
    files = [path for row in read.table if (path := read.locate(row)) is not None]
    return [study.specimen, *dict.fromkeys(path.parent for path in files)]


def _keep_settings(study: Study, path: Path) -> None:
    """Write study.yaml, unless the workflow's says the same: a newer one has it prepare again."""
    if not path.is_file() or settings_on_file(load_study(path)) != settings_on_file(study):
        write_study(study, path)


def _known(study: Study, candidate: str) -> str:
    if candidate not in study.candidates:
        raise UserError(
            f"study {study.name} has no candidate {candidate!r}"
            f"{nearest(candidate, study.candidates)}"
        )
    return candidate


def _values(settings: Sequence[str]) -> Iterator[tuple[str, float | str]]:
    """Parameters given as NAME=VALUE: SI, or with a unit."""
    once_each(settings, "--set")
    for setting in settings:
        name, _, value = setting.partition("=")
        number, unit = match.groups() if (match := NUMBER_AND_UNIT.match(value)) else ("", "")
        if not number:
            raise UserError(
                f"--set {setting!r}: expected NAME=VALUE with a number in SI units, or with its "
                "unit, such as 'E_0=1.5 MPa'"
            )
        yield name.strip(), value if unit else float(number)
