"""Studies and populations by the names that users give them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from deabayes.faults import Faults, UserError, nearest

if TYPE_CHECKING:
    from deabayes.population.settings import Population
    from deabayes.study import Study


def find_study(study: str, config: Path) -> Study:
    """A study by its settings file (`results/NAME/study.yaml`) or by its name in `config`."""
    from deabayes.reading.yaml_file import read_yaml
    from deabayes.studies import load_studies, load_study

    if Path(study).suffix in (".yaml", ".yml"):
        return load_study(Path(study))
    studies = {each.name: each for each in load_studies(config)}
    if study in studies:
        return studies[study]
    if study in read_yaml(config)["studies"]:
        parts = [n for n, each in studies.items() if each.select and n.startswith(f"{study}_")]
        raise UserError(f"{config}: {study} is split into {', '.join(parts)}; name one of them")
    raise UserError(f"{config}: has no study {study!r}{nearest(study, studies)}")


def find_population(name: str, config: Path) -> Population:
    """A population of a config by name, checked against its studies."""
    from deabayes.population.checks import check_population
    from deabayes.population.settings import load_populations
    from deabayes.studies import load_studies

    populations = {each.name: each for each in load_populations(config)}
    if name not in populations:
        hint = nearest(name, populations) or "; name one under `populations`"
        raise UserError(f"{config}: has no population {name!r}{hint}")
    studies = {study.name: study for study in load_studies(config)}
    faults = check_population(populations[name], studies)
    if faults:
        raise Faults(faults)
    return populations[name]
