"""The `deabayes` command: each subcommand calls one function of the library."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import click

from deabayes.command_options import CONFIG, EXISTING, RESULTS, TARGET
from deabayes.faults import UserError
from deabayes.population_command import population


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="`snakemake --cores 2` runs all stages of all studies; these commands run one by hand.",
)
@click.version_option(package_name="deabayes")
def cli() -> None:
    """Bayesian characterisation of dielectric elastomer actuators.

    STUDY is the name of a study in config.yaml, or a file with one study's
    settings (results/NAME/study.yaml).
    """


@cli.command()
@click.argument("name")
@click.option("--system", required=True, help="tubular, tensile_strip, ...")
@click.option("--folder", type=TARGET, default=Path("data"), show_default=True)
@CONFIG
def new(name: str, system: str, folder: Path, config: Path) -> None:
    """Write a commented study folder to fill in, and print its config entry."""
    from deabayes.by_hand import new_by_name

    click.echo(new_by_name(name, system, folder, config), nl=False)


@cli.command()
@click.argument("what")
@CONFIG
def check(what: str, config: Path) -> None:
    """Check a study folder: print what was understood and every fault found.

    WHAT is a folder (data/NAME), or the name of a study: then also what
    config.yaml asks of its records. Ends with status 1 if anything is at fault.
    """
    from deabayes.by_hand import check_by_name

    check_by_name(what, config, click.echo)


@cli.command()
@click.argument("study")
@CONFIG
@click.option("-o", "--output", type=TARGET, required=True, help="Folder for {experiment}.nc.")
def prepare(study: str, config: Path, output: Path) -> None:
    """Read and prepare the records of STUDY for inference."""
    from deabayes.by_hand import prepare_by_name

    prepare_by_name(study, config, output)


@cli.command(name="compile")
@click.argument("studies", nargs=-1, required=True)
@CONFIG
def compile_kernels(studies: Sequence[str], config: Path) -> None:
    """Compile what the prepared STUDIES need, once, into numba's cache on disk.

    The prepared records are expected beside each study's settings file.
    """
    from deabayes.compiling import compile_study

    for study in studies:
        compile_study(study, config)


@cli.command()
@click.argument("study")
@click.argument("candidate")
@CONFIG
@RESULTS
@click.option("--prepared", type=EXISTING, help="Folder of the prepared records.")
@click.option("--ensemble", type=click.IntRange(min=1), help="Run only this ensemble.")
@click.option("-o", "--output", type=TARGET, help="The ensemble's file.")
def fit(
    study: str,
    candidate: str,
    config: Path,
    results: Path,
    prepared: Path | None,
    ensemble: int | None,
    output: Path | None,
) -> None:
    """Sample the posterior of CANDIDATE (voigt_kelvin_2, kv_gm_3, ...) in STUDY.

    Without --ensemble: prepare, run every ensemble in turn, pool them and say
    whether the result converged. Interrupt it at any time: the same command
    goes on where it stopped.
    """
    from deabayes.by_hand import fit_by_name, fit_one

    if ensemble is None:
        if prepared is not None or output is not None:
            raise click.UsageError("--prepared and --output belong to --ensemble.")
        click.echo(fit_by_name(study, candidate, config, results))
    elif prepared is None or output is None:
        raise click.UsageError("--ensemble needs --prepared and --output.")
    else:
        fit_one(study, candidate, config, prepared, ensemble, output)


@cli.command()
@click.argument("study")
@click.argument("candidate")
@click.argument("ensembles", nargs=-1, required=True, type=EXISTING)
@CONFIG
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="posterior.nc")
@click.option("--summary", type=TARGET, required=True, help="summary.csv")
def pool(
    study: str,
    candidate: str,
    ensembles: Sequence[Path],
    config: Path,
    prepared: Path,
    output: Path,
    summary: Path,
) -> None:
    """Pool the ENSEMBLES of a candidate: diagnostics, posterior file, summary."""
    from deabayes.by_hand import pool_by_name

    pool_by_name(study, candidate, config, prepared, ensembles, output, summary)


@cli.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="scores.json")
def score(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence, BIC and leave-one-experiment-out score of one posterior."""
    from deabayes.pipeline import score_candidate

    score_candidate(posterior, prepared, output)


@cli.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="nested.json")
def nested(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence by nested sampling, to check that of `score`; needs the package dynesty."""
    from deabayes.pipeline import check_evidence

    check_evidence(posterior, prepared, output)


@cli.command()
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
    from deabayes.by_hand import compare_posteriors

    click.echo(compare_posteriors(posteriors, results, prepared, output))


@cli.command()
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
    from deabayes.by_hand import weigh_experiments

    click.echo(weigh_experiments(results, config, asked, output), nl=False)


@cli.command()
@click.argument("posterior")
@RESULTS
@click.option("--prepared", type=EXISTING, help="Default: prepared/ of the posterior's study.")
@click.option("-o", "--output", type=TARGET, help="Folder; default: predictions/ beside it.")
@click.option("--errors", type=TARGET, help="Default: errors.csv beside the posterior.")
def predict(
    posterior: str,
    results: Path,
    prepared: Path | None,
    output: Path | None,
    errors: Path | None,
) -> None:
    """Predict every record, with three bands, and score the predictions.

    POSTERIOR is a file, or the name of a fitted study (all its candidates).
    """
    from deabayes.by_hand import predict_posteriors

    click.echo(predict_posteriors(posterior, results, prepared, output, errors))


@cli.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, help="Folder; default: analyses/ in RESULTS.")
def analyse(results: Path, output: Path | None) -> None:
    """Compute what papers of the system report, from one study's results folder (results/NAME)."""
    from deabayes.pipeline import analyse_study

    analyse_study(results, output or results / "analyses")


@cli.command()
@click.argument("results", type=EXISTING)
@click.option("-o", "--output", type=TARGET, required=True)
def figures(results: Path, output: Path) -> None:
    """Draw every figure of one study's results folder (results/NAME)."""
    from deabayes.pipeline import draw_figures

    draw_figures(results, output)


@cli.command()
@click.argument("folders", nargs=-1, required=True, type=EXISTING)
@click.option("-o", "--output", type=TARGET, default=Path("results/report/index.html"))
@click.option("--tables", type=TARGET, default=Path("results/report/tables"))
@click.option("--left-out", multiple=True, help="A line on a study that could not be run.")
def report(folders: Sequence[Path], output: Path, tables: Path, left_out: Sequence[str]) -> None:
    """Build the report page from results folders (results/NAME ...)."""
    from deabayes.pipeline import build_report

    build_report(folders, output, tables, left_out)
    click.echo(f"Report: {output.resolve()}")


@cli.command()
@click.argument("system")
@click.argument("candidate")
@click.option("--specimen", type=EXISTING, required=True, help="Study folder (specimen.yaml).")
@click.option("--excitation", type=EXISTING, required=True, help="A record with time and drive.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A parameter, SI.")
@click.option("-o", "--output", type=TARGET, required=True, help="response.csv")
@CONFIG
def simulate(
    system: str,
    candidate: str,
    specimen: Path,
    excitation: Path,
    settings: Sequence[str],
    output: Path,
    config: Path,
) -> None:
    """Simulate the response of CANDIDATE of SYSTEM to an excitation record."""
    from deabayes.by_hand import simulate_record

    simulate_record(system, candidate, specimen, excitation, settings, output, config)


@cli.command()
@click.argument("posterior", type=EXISTING)
@click.option("--to", required=True, help="csv, json, mat, state-space")
@click.option("-o", "--output", type=TARGET, required=True)
@click.option("--rate", help="state-space: also discrete, at this sample rate ('10 kHz').")
@click.option("--draws", type=click.IntRange(min=1), help="state-space: how many  [default: 200]")
@click.option("--load-g", type=float, help="state-space: hung mass in g  [default: 0]")
@click.option("--bias", help="state-space: linearise about this voltage ('2 kV').")
def export(posterior: Path, to: str, output: Path, **options: object) -> None:
    """Write the draws of POSTERIOR in another program's format.

    state-space: A, B, C, D of every draw of a linear model, as .json or .mat by
    OUTPUT's ending. The input is the squared voltage, with --bias the voltage.
    """
    from deabayes.pipeline import export_posterior

    export_posterior(posterior, to, output, **options)


@cli.command()
@click.argument("studies", nargs=-1)
@CONFIG
def data(studies: Sequence[str], config: Path) -> None:
    """Download the public data sets that STUDIES (default: all) need, checked by SHA-256."""
    from deabayes.by_hand import download

    for line in download(studies, config):
        click.echo(line)


cli.add_command(population)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; a user's mistake ends with one message and status 1 or 2."""
    try:
        cli.main(args=arguments, prog_name="deabayes", standalone_mode=False)
    except UserError as error:
        _end(f"deabayes: {error}", 1)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        _end("deabayes: interrupted; the same command goes on where this one stopped", 1)
    except OSError as error:
        if error.filename is None:
            raise
        _end(f"deabayes: {error.filename}: {error.strerror}", 1)
    except Exception as error:
        _end_at_an_own_model(error)
        raise


def _end_at_an_own_model(error: Exception) -> None:
    """What fails in a user's own model is a mistake of the user's: said with file and line."""
    from deabayes.own_models import fault_in_a_model

    fault = fault_in_a_model(error)
    if fault is not None:
        _end(f"deabayes: {fault}", 1)


def _end(message: str, status: int) -> None:
    click.echo(message, err=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
