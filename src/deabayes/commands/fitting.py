"""Commands from records to posteriors."""

from __future__ import annotations

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
@click.argument("study")
@CONFIG
def compile_kernels(study: str, config: Path) -> None:
    """Compile what STUDY needs, once, into numba's cache on disk.

    STUDY is a settings file with the prepared records beside it. Another study of the same
    system waits until this one is compiled.
    """
    from deabayes.commands.compiling import compile_study

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
    from deabayes.commands.by_hand import fit_by_name

    click.echo(fit_by_name(study, candidate, config, results, prepared, output, summary))
