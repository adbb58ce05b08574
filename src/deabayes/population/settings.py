"""Read and write populations: the entries of `populations:` in config.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from deabayes.faults import Faults, UserError, nearest
from deabayes.studies import load_studies, write_settings
from deabayes.study import Sampling, Settings, Study

FOLDER = "populations"
"""Folder for results of populations, beside the folders of the studies."""
SETTINGS = "population.yaml"
"""File that marks the folder of a population."""


@dataclass(frozen=True)
class Population:
    """One entry of `populations:` with its sampling settings.

    Attributes
    ----------
    studies : names of the members' studies, with `split_by` resolved. Predictions of a new
        specimen are made for the records of the first study.
    candidate : candidate whose posteriors are combined.
    parameters : parameters that differ between specimens.
    spread : priors of the standard deviation between specimens, by parameter.
    """

    name: str
    studies: tuple[str, ...]
    candidate: str
    parameters: tuple[str, ...]
    spread: Mapping[str, Settings] = field(default_factory=dict)
    sampling: Sampling = field(default_factory=Sampling)


def load_populations(
    config: Path | Mapping[str, Any], where: str | None = None
) -> tuple[Population, ...]:
    """Load all populations of a config in order; empty if it has no `populations:`.

    Parameters
    ----------
    config, where : as for `deabayes.studies.load_studies`.

    Raises
    ------
    Faults : all violations of the schema, and all studies that the config does not have.
    """
    from deabayes.records.schema import read_yaml

    studies = load_studies(config, where)
    content = dict(config) if isinstance(config, Mapping) else read_yaml(Path(config))
    place = where or ("config" if isinstance(config, Mapping) else str(config))
    entries = content.get("populations") or {}
    faults = []
    if entries and any(study.name.lower() == FOLDER for study in studies):
        faults.append(f"{place}: the results of populations are in {FOLDER}/; rename the study")
    populations = []
    for name, settings in entries.items():
        try:
            members = _members(settings["studies"], content["studies"], studies)
        except UserError as error:
            faults += [f"{place}, populations.{name}: {fault}" for fault in str(error).splitlines()]
            continue
        sampling = {**(content.get("sampling") or {}), **(settings.get("sampling") or {})}
        given = {**settings, "name": name, "studies": members, "sampling": sampling}
        populations.append(from_settings(given))
    if faults:
        raise Faults(faults)
    return tuple(populations)


def load_population(path: Path) -> Population:
    """Load a population from its own file (`results/populations/NAME/population.yaml`).

    Raises
    ------
    Faults : violations of the schema.
    """
    from deabayes.records.schema import read_yaml, violations

    content = read_yaml(Path(path))
    name = str(content.pop("name", None) or Path(path).parent.name)
    study = {"specimen": "any", "candidates": ["any"]}
    whole = {"studies": {"any": study}, "populations": {name: content}}
    faults = violations(whole, "config", str(path))
    if faults:
        raise Faults(faults)
    return from_settings({"name": name, **content})


def from_settings(settings: Mapping[str, Any]) -> Population:
    """Create a population from the output of `to_settings`, or a config entry plus its `name`."""
    given = {key: value for key, value in settings.items() if value is not None}
    for key in ("studies", "parameters"):
        given[key] = tuple(given[key])
    given["sampling"] = Sampling(**(given.get("sampling") or {}))
    return Population(**given)


def to_settings(population: Population) -> dict[str, Any]:
    """Return the population as lists, mappings, texts and numbers for YAML or JSON."""
    settings = asdict(population)
    return settings | {key: list(settings[key]) for key in ("studies", "parameters")}


def write_population(population: Population, path: Path) -> None:
    """Write population.yaml, unless the file already has this content (keeps its time stamp)."""
    write_settings(to_settings(population), path)


def _members(
    names: Sequence[str], entries: Mapping[str, Any], studies: Sequence[Study]
) -> list[str]:
    """Names of the members' studies; a study with `split_by` is replaced by its parts."""
    known = {study.name: study for study in studies}
    members: list[str] = []
    unknown = []
    for name in names:
        column = (entries.get(name) or {}).get("split_by")
        if column is not None:
            members += [
                study.name
                for study in studies
                if column in study.select and study.name.startswith(f"{name}_")
            ]
        elif name in known:
            members.append(name)
        else:
            unknown.append(f"studies: there is no study {name!r}{nearest(name, known)}")
    if unknown:
        raise Faults(unknown)
    return list(dict.fromkeys(members))
