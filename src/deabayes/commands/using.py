"""Commands for other programs: responses of a model, draws in other formats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from deabayes.commands.options import CONDITIONS, CONFIG, EXISTING, TARGET
from deabayes.commands.output import keep_inputs

FORMATS = (
    "csv", "parquet", "json", "mat", "state-space", "abaqus", "ansys", "pymc", "numpyro",
)  # fmt: skip
"""Those of `deabayes.export.REGISTRY`, told without importing it."""


@click.command()
@click.argument("system")
@click.argument("candidate")
@click.option("--specimen", type=EXISTING, required=True, help="Study folder (specimen.yaml).")
@click.option("--excitation", type=EXISTING, required=True, help="A record with time and drive.")
@click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", help="A parameter, SI or with a unit."
)
@CONDITIONS
@click.option("-o", "--output", type=TARGET, required=True, help="response.csv")
@CONFIG
def simulate(
    system: str,
    candidate: str,
    specimen: Path,
    excitation: Path,
    settings: Sequence[str],
    conditions: Sequence[str],
    output: Path,
    config: Path,
) -> None:
    """Simulate the response of CANDIDATE of SYSTEM to an excitation record."""
    from deabayes.commands.by_hand import simulate_record

    tables = (specimen / "specimen.yaml", specimen / "experiments.csv")
    keep_inputs(output, excitation, config, *tables)
    failure = simulate_record(
        system, candidate, specimen, excitation, settings, conditions, output, config
    )
    if failure:
        click.echo(f"{output}: cells are empty: {failure}", err=True)


def complete_format(_context: object, _parameter: object, incomplete: str) -> list[str]:
    """Formats that begin so, for a shell."""
    return [form for form in FORMATS if form.startswith(incomplete)]


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option(
    "--to",
    required=True,
    metavar="FORMAT",
    help=f"One of {', '.join(FORMATS)}.",
    shell_complete=complete_format,
)
@click.option("-o", "--output", type=TARGET, required=True)
@click.option("--rate", help="state-space: also discrete, at this sample rate ('10 kHz').")
@click.option(
    "--draws",
    type=click.IntRange(min=1),
    help="state-space, abaqus, ansys: how many draws  [default: 200; of cards, the medians]",
)
@click.option("--load-g", type=float, help="state-space: hung mass in g  [default: 0]")
@click.option("--bias", help="state-space: linearise about this voltage ('2 kV').")
def export(posterior: Path, to: str, output: Path, **options: object) -> None:
    """Write POSTERIOR in another program's format.

    csv, parquet, json, mat: every draw of every quantity, SI.

    state-space: A, B, C, D of every draw of a linear model, as .json or .mat by
    OUTPUT's ending. The input is the squared voltage, with --bias the voltage.

    abaqus (.inp), ansys (.mac or .inp): a material card of the medians, or with
    --draws numbered cards of as many draws.

    pymc, numpyro (.py): a Python function that defines the posterior's material
    and specimen parameters as a prior.
    """
    from deabayes.pipeline import export_posterior

    keep_inputs(output, posterior)
    converged, cautions = export_posterior(posterior, to, output, **options)
    for caution in cautions:
        click.echo(f"{output}: {caution}", err=True)
    if not converged:
        click.echo(f"{output}: NOT CONVERGED, do not use these numbers", err=True)
