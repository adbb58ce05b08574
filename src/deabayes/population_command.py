"""The command `deabayes population`: several specimens' posteriors put together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from deabayes.command_options import CONFIG, RESULTS, TARGET
from deabayes.faults import Faults, UserError, nearest

if TYPE_CHECKING:
    from deabayes.population.settings import Population


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
        found = _find(population, config)
    folder = output or results / FOLDER / found.name
    said = fit_population(found, results, folder, progress=True)
    if Path(population) != folder / SETTINGS:
        write_population(found, folder / SETTINGS)
    click.echo(said)


def _find(name: str, config: Path) -> Population:
    """A population of a config by name, checked against its studies."""
    from deabayes.population.checks import check_population
    from deabayes.population.settings import load_populations
    from deabayes.study import load_studies

    populations = {each.name: each for each in load_populations(config)}
    if name not in populations:
        raise UserError(f"{config}: has no population {name!r}{nearest(name, populations)}")
    studies = {study.name: study for study in load_studies(config)}
    faults = check_population(populations[name], studies)
    if faults:
        raise Faults(faults)
    return populations[name]
