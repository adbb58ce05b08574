"""Commands that compare candidates and show results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from deabayes.cli.arguments import (
    CONFIG,
    EXISTING,
    RESULTS,
    TARGET,
    check_folder_of,
    find_population,
    find_study,
    keep_inputs,
    posterior_files,
    study_folders,
)


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="scores.json")
def score(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence and BIC of one posterior."""
    from deabayes.pipeline import score_candidate

    keep_inputs(output, posterior)
    score_candidate(posterior, prepared, output)


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

    Posteriors without scores are scored first. Candidates that did not converge are listed, and
    not ranked.
    """
    from deabayes.pipeline import compare_candidates, score_candidate

    files = posterior_files(posteriors, results)
    study = files[0].parent.parent
    prepared, output = prepared or study / "prepared", output or study / "comparison.csv"
    keep_inputs(output, prepared, *files, *(file.with_name("scores.json") for file in files))
    for file in files:
        scores = file.with_name("scores.json")
        if not scores.exists() or scores.stat().st_mtime < file.stat().st_mtime:
            score_candidate(file, prepared, scores)
    compare_candidates(files, prepared, output)
    click.echo(output.read_text())


@click.command()
@click.argument("results", type=EXISTING)
@CONFIG
@click.option("--asked", help="further_experiments as YAML; default: those of the study.")
@click.option("-o", "--output", type=TARGET, help="Default: further_experiments.csv in RESULTS.")
def further(results: Path, config: Path, asked: str | None, output: Path | None) -> None:
    """Compare experiments that could be done next, from one study's results (results/NAME).

    The table says how surely each experiment would decide between the candidates that are still
    possible, and how much it would tell about their parameters. It contains the held-out records
    and the experiments under further_experiments in the study.
    """
    from deabayes.pipeline import entries_of, further_experiments

    if asked is None:
        entries = find_study(results.resolve().name, config).further_experiments
    else:
        entries = entries_of(asked)
    output = output or results / "further_experiments.csv"
    keep_inputs(output, config, results / "study.yaml", results / "comparison.csv")
    further_experiments(results, entries, output)
    click.echo(output.read_text(), nl=False)


@click.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, help="Folder; default: analyses/ in RESULTS.")
def analyse(results: Path, output: Path | None) -> None:
    """Compute what papers of the system report, from one study's results folder (results/NAME)."""
    from deabayes.pipeline import analyse_study

    output = output or results / "analyses"
    check_folder_of("analyses", output, "tables", replaced=True)
    analyse_study(results, output)


@click.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, required=True)
@click.option("--names", is_flag=True, help="Write study and candidate into every drawing.")
def figures(results: Path, output: Path, names: bool) -> None:
    """Draw every figure of one study's results folder (results/NAME), as SVG, PDF and PNG."""
    from deabayes.pipeline import draw_figures

    check_folder_of("figures", output, "svg")
    draw_figures(results, output, names)


@click.command()
@click.argument("folders", nargs=-1, required=True)
@RESULTS
@click.option("-o", "--output", type=TARGET, default=Path("results/report/index.html"))
@click.option("--tables", type=TARGET, help="Folder; default: tables/ beside the page.")
@click.option("--left-out", multiple=True, help="A sentence on a study that was not run.")
def report(
    folders: Sequence[str],
    results: Path,
    output: Path,
    tables: Path | None,
    left_out: Sequence[str],
) -> None:
    """Build the report page from results folders (results/NAME ...), or of studies by name."""
    from deabayes.pipeline import build_report

    tables = tables or output.parent / "tables"
    build_report(study_folders(folders, results), output, tables, left_out)
    click.echo(f"Report: {output.resolve()}")


@click.command()
@click.argument("state", type=EXISTING)
@click.option("-o", "--output", type=TARGET, required=True, help="The page.")
@click.option("--tables", type=TARGET, help="Folder; default: tables/ beside the page.")
def finish(state: Path, output: Path, tables: Path | None) -> None:
    """Build the report of a run in which jobs failed; it names them and shows the other results.

    STATE is the file in which Snakemake lists the jobs of the run (results/logs/unfinished.json).
    """
    from deabayes.pipeline.publish import finish as finish_run

    finish_run(state, output, tables or output.parent / "tables")
    click.echo(f"Report: {output.resolve()}")


@click.command()
@click.option(
    "--config",
    "--configfile",
    "config",
    type=TARGET,
    default=Path("config.yaml"),
    show_default=True,
    help="The file whose studies are run.",
)
@click.option("--results", type=TARGET, help="Default: as the config says, or results.")
def status(config: Path, results: Path | None) -> None:
    """Say what a run is doing, what is done and what is left, by study and candidate.

    Call it in the folder in which `snakemake` runs.
    """
    from deabayes.checks.config import check_config, load_config
    from deabayes.pipeline import status as stages
    from deabayes.records.schema import read_yaml

    content = read_yaml(config)
    found = load_config(content, str(config))
    results = results or Path((content.get("pathvars") or {}).get("results", "results"))
    check_config(found, results)
    run = stages.Run.last(Path())
    for line in [run.in_words(), *stages.status(found.studies, results, run)]:
        click.echo(line)
    for line in [*found.faults_once(), *found.left_out]:
        click.echo(line)


@click.command()
@click.argument("population")
@CONFIG
@RESULTS
@click.option("-o", "--output", type=TARGET, help="Folder; default: populations/NAME in results.")
def population(population: str, config: Path, results: Path, output: Path | None) -> None:
    """Combine the fitted specimens of POPULATION: mean, spread, a new specimen.

    POPULATION is a name under `populations:` in config.yaml, or a file with its settings
    (results/populations/NAME/population.yaml). Fit its studies first.
    """
    from deabayes.pipeline import fit_population
    from deabayes.population.settings import FOLDER, SETTINGS, load_population, write_population

    if Path(population).suffix in (".yaml", ".yml"):
        settings = load_population(Path(population))
    else:
        settings = find_population(population, config)
    folder = output or results / FOLDER / settings.name
    verdict = fit_population(settings, results, folder, progress=True)
    if Path(population) != folder / SETTINGS:
        write_population(settings, folder / SETTINGS)
    click.echo(verdict)
