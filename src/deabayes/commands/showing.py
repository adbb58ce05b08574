"""Commands that show what posteriors say: predictions, figures, the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import click

from deabayes.commands.options import CONDITIONS, EXISTING, RESULTS, TARGET
from deabayes.faults import UserError


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
    from deabayes.commands.by_hand import predict_posteriors
    from deabayes.commands.find_results import one_posterior
    from deabayes.commands.own_protocol import predict_record

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
    from deabayes.commands.output import a_folder_to_replace
    from deabayes.pipeline import analyse_study

    output = output or results / "analyses"
    a_folder_to_replace("analyses", output, "tables")
    analyse_study(results, output)


@click.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, required=True)
def figures(results: Path, output: Path) -> None:
    """Draw every figure of one study's results folder (results/NAME)."""
    from deabayes.commands.output import a_folder_of
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
    from deabayes.commands.find_results import study_folders
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
    from deabayes.pipeline.unfinished import finish as finish_run

    finish_run(state, output, tables or output.parent / "tables")
    click.echo(f"Report: {output.resolve()}")


def _go_together(
    own_drive: bool, with_drive: Mapping[str, object], with_records: Mapping[str, object]
) -> None:
    """Refuse options that mean nothing for what is predicted, a drive of one's own or records."""
    for name, value in (with_records if own_drive else with_drive).items():
        if value:
            told = "does not go" if own_drive else "goes"
            raise UserError(f"{name} {told} with --excitation")
