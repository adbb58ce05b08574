"""The command `deabayes population`: several specimens' posteriors put together."""

from __future__ import annotations

from pathlib import Path

import click

from deabayes.commands.find import find_population
from deabayes.commands.options import CONFIG, RESULTS, TARGET


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
