"""Commands from records to posteriors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from deabayes.commands.options import CONFIG, EXISTING, RESULTS, TARGET


@click.command()
@click.argument("study")
@CONFIG
@click.option("-o", "--output", type=TARGET, required=True, help="Folder for {experiment}.nc.")
def prepare(study: str, config: Path, output: Path) -> None:
    """Read and prepare the records of STUDY for inference."""
    from deabayes.commands.by_hand import prepare_by_name

    prepare_by_name(study, config, output)


@click.command(name="compile")
@click.argument("studies", nargs=-1, required=True)
@CONFIG
def compile_kernels(studies: Sequence[str], config: Path) -> None:
    """Compile what the prepared STUDIES need, once, into numba's cache on disk.

    The prepared records are expected beside each study's settings file.
    """
    from deabayes.commands.compiling import compile_study

    for study in studies:
        compile_study(study, config)


@click.command()
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
    from deabayes.commands.by_hand import fit_by_name, fit_one

    if ensemble is None:
        if prepared is not None or output is not None:
            raise click.UsageError("--prepared and --output belong to --ensemble.")
        click.echo(fit_by_name(study, candidate, config, results))
    elif prepared is None or output is None:
        raise click.UsageError("--ensemble needs --prepared and --output.")
    else:
        fit_one(study, candidate, config, prepared, ensemble, output)


@click.command()
@click.argument("study")
@click.argument("candidate")
@click.argument("ensembles", nargs=-1, required=True, type=EXISTING)
@CONFIG
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="posterior.nc")
@click.option("--summary", type=TARGET, required=True, help="summary.csv")
@click.option("--processes", type=click.IntRange(min=1), default=1, show_default=True)
def pool(
    study: str,
    candidate: str,
    ensembles: Sequence[Path],
    config: Path,
    prepared: Path,
    output: Path,
    summary: Path,
    processes: int,
) -> None:
    """Pool the ENSEMBLES of a candidate: diagnostics, posterior file, summary.

    Where they fail a gate they are sampled on, with --processes side by side.
    """
    from deabayes.commands.by_hand import pool_by_name

    pool_by_name(study, candidate, config, prepared, ensembles, output, summary, processes)
