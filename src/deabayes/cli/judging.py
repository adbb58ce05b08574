"""Commands that compare candidates and show results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import click

from deabayes.cli.arguments import (
    CONDITIONS,
    CONFIG,
    EXISTING,
    RESULTS,
    TARGET,
    find_population,
    find_study,
    found_posteriors,
    keep_inputs,
)
from deabayes.faults import UserError


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="scores.json")
def score(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence, BIC and leave-one-experiment-out score of one posterior."""
    from deabayes.pipeline import score_candidate

    keep_inputs(output, posterior)
    for line in score_candidate(posterior, prepared, output):
        click.echo(line)


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="nested.json")
def nested(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence by nested sampling, to check that of `score`; needs the package dynesty."""
    from deabayes.pipeline import check_evidence

    keep_inputs(output, posterior)
    check_evidence(posterior, prepared, output)


@click.command()
@click.argument("posteriors", nargs=-1, required=True)
@RESULTS
@click.option("--prepared", type=EXISTING, help="Default: prepared/ of the posteriors' study.")
@click.option("-o", "--output", type=TARGET, help="Default: comparison.csv of the study.")
def compare(
    posteriors: Sequence[str], results: Path, prepared: Path | None, output: Path | None
) -> None:
    """Rank candidates: POSTERIORS are files, or the name of one fitted study.

    Candidates that did not converge are listed, and not ranked.
    """
    click.echo(compare_posteriors(posteriors, results, prepared, output))


@click.command()
@click.argument("results", type=EXISTING)
@CONFIG
@click.option("--asked", help="further_experiments as YAML; default: those of the config's study.")
@click.option("-o", "--output", type=TARGET, help="Default: further_experiments.csv in RESULTS.")
def further(results: Path, config: Path, asked: str | None, output: Path | None) -> None:
    """Weigh experiments that could be done next, from one study's results (results/NAME).

    How surely would each tell the candidates apart that the records leave in the running, and
    how much would it tell about their parameters? Considered are the held-out records and what
    the study asks for under further_experiments.
    """
    click.echo(weigh_experiments(results, config, asked, output), nl=False)


@click.command()
@click.argument("posterior")
@RESULTS
@click.option("--prepared", type=EXISTING, help="Default: prepared/ of the posterior's study.")
@click.option("-o", "--output", type=TARGET, help="Folder; default: predictions/ beside it.")
@click.option("--errors", type=TARGET, help="Default: errors.csv beside the posterior.")
@click.option("--excitation", type=EXISTING, help="Predict this drive instead of the records.")
@click.option("--response", help="With --excitation: which; default: that of the calibration.")
@click.option("--protocol", help="With --excitation: as which protocol (predict_with).")
@CONDITIONS
def predict(
    posterior: str,
    results: Path,
    prepared: Path | None,
    output: Path | None,
    errors: Path | None,
    excitation: Path | None,
    response: str | None,
    protocol: str | None,
    conditions: Sequence[str],
) -> None:
    """Predict every record, with three bands, and score the predictions.

    POSTERIOR is a file, or the name of a fitted study (all its candidates).

    With --excitation FILE (a record with `time [s]` and the drive, any unit) it is a file, or a
    study with one fitted candidate, and what is predicted is the response to that drive, into
    -o FILE.csv or FILE.nc.
    """
    from deabayes.cli.arguments import one_posterior
    from deabayes.cli.using import predict_record

    _go_together(
        excitation is not None,
        {"--response": response, "--protocol": protocol, "--condition": conditions},
        {"--prepared": prepared, "--errors": errors},
    )
    if excitation is not None:
        for line in predict_record(
            one_posterior(posterior, results), excitation, output, response, protocol, conditions
        ):
            click.echo(line, err=True)
        return
    click.echo(predict_posteriors(posterior, results, prepared, output, errors))


@click.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, help="Folder; default: analyses/ in RESULTS.")
def analyse(results: Path, output: Path | None) -> None:
    """Compute what papers of the system report, from one study's results folder (results/NAME)."""
    from deabayes.cli.arguments import a_folder_to_replace
    from deabayes.pipeline import analyse_study

    output = output or results / "analyses"
    a_folder_to_replace("analyses", output, "tables")
    analyse_study(results, output)


@click.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, required=True)
def figures(results: Path, output: Path) -> None:
    """Draw every figure of one study's results folder (results/NAME)."""
    from deabayes.cli.arguments import a_folder_of
    from deabayes.pipeline import draw_figures

    a_folder_of("figures", output, "svg")
    draw_figures(results, output)


@click.command()
@click.argument("folders", nargs=-1, required=True)
@RESULTS
@click.option("-o", "--output", type=TARGET, default=Path("results/report/index.html"))
@click.option("--tables", type=TARGET, help="Folder; default: tables/ beside the page.")
@click.option("--left-out", multiple=True, help="A line on a study that could not be run.")
def report(
    folders: Sequence[str],
    results: Path,
    output: Path,
    tables: Path | None,
    left_out: Sequence[str],
) -> None:
    """Build the report page from results folders (results/NAME ...), or of studies by name."""
    from deabayes.cli.arguments import study_folders
    from deabayes.pipeline import build_report

    tables = tables or output.parent / "tables"
    build_report(study_folders(folders, results), output, tables, left_out)
    click.echo(f"Report: {output.resolve()}")


@click.command()
@click.argument("state", type=EXISTING)
@click.option("-o", "--output", type=TARGET, required=True, help="The page.")
@click.option("--tables", type=TARGET, help="Folder; default: tables/ beside the page.")
def finish(state: Path, output: Path, tables: Path | None) -> None:
    """Build the report of a run in which jobs failed; it names them and shows what is there.

    STATE is what Snakemake knew at the end of the run (results/logs/unfinished.json).
    """
    from deabayes.pipeline.publish import finish as finish_run

    finish_run(state, output, tables or output.parent / "tables")
    click.echo(f"Report: {output.resolve()}")


def _go_together(
    own_drive: bool, with_drive: Mapping[str, object], with_records: Mapping[str, object]
) -> None:
    """Refuse options that do not belong to this kind of prediction."""
    for name, value in (with_records if own_drive else with_drive).items():
        if value:
            told = "does not go" if own_drive else "goes"
            raise UserError(f"{name} {told} with --excitation")


@click.command()
@click.argument("population")
@CONFIG
@RESULTS
@click.option("-o", "--output", type=TARGET, help="Folder; default: populations/NAME in results.")
def population(population: str, config: Path, results: Path, output: Path | None) -> None:
    """Put the fitted specimens of POPULATION together: mean, spread, a new specimen.

    POPULATION is a name under `populations:` in config.yaml, or a file with its settings
    (results/populations/NAME/population.yaml). Its studies are to be fitted before.
    """
    from deabayes.pipeline import fit_population
    from deabayes.population.settings import FOLDER, SETTINGS, load_population, write_population

    if Path(population).suffix in (".yaml", ".yml"):
        found = load_population(Path(population))
    else:
        found = find_population(population, config)
    folder = output or results / FOLDER / found.name
    said = fit_population(found, results, folder, progress=True)
    if Path(population) != folder / SETTINGS:
        write_population(found, folder / SETTINGS)
    click.echo(said)


def compare_posteriors(
    sources: Sequence[str], results: Path, prepared: Path | None, output: Path | None
) -> str:
    """Score posteriors without a score, rank all; return the table as text."""
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
    """Compare possible further experiments; return the table as text.

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
    """Predict with one posterior or all of a study; return where the tables are."""
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
