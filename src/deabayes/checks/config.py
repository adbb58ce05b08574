"""Check the studies of a config by name, each for itself, before the first job of a workflow."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deabayes.checks.prior_sources import Sources
from deabayes.checks.study import check_names
from deabayes.faults import Faults, Report, UserError, nearest
from deabayes.population.checks import check_population
from deabayes.population.settings import FOLDER, Population, load_populations
from deabayes.records.download import missing_data
from deabayes.studies import load_studies
from deabayes.study import Study

REPORT, LOGS = "report", "logs"
"""Folders of results that belong to no study."""


@dataclass
class CheckedConfig:
    """The studies and populations that can be run, and why the others cannot.

    Attributes
    ----------
    left_out : a line on each folder whose public data are not here, and on each population that
        lacks a study.
    without_data : why each study is left out whose public data are not here.
    faults : mistakes, by the name of the study or population in which they are.
    """

    studies: dict[str, Study] = field(default_factory=dict)
    populations: dict[str, Population] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    without_data: dict[str, str] = field(default_factory=dict)
    faults: dict[str, list[str]] = field(default_factory=dict)

    def faults_once(self) -> list[str]:
        """Return every fault, each once: two studies may share a folder."""
        return list(dict.fromkeys(fault for faults in self.faults.values() for fault in faults))

    def left_out_by_faults(self) -> list[str]:
        """Return a line on each study or population with faults."""
        return [
            f"{name} left out: {faults[0]}{f' (and {len(faults) - 1} more)' * (len(faults) > 1)}"
            for name, faults in self.faults.items()
        ]


def load_config(settings: Mapping[str, Any], where: str) -> CheckedConfig:
    """Load each study of a config for itself: a fault in one leaves the others.

    Studies without their public data are left out. Nothing else is checked.

    Parameters
    ----------
    where : the file or files of the settings, as for `load_studies`.

    Raises
    ------
    Faults : mistakes outside the studies.
    """
    found = CheckedConfig()
    entries, sound = settings.get("studies"), settings
    try:
        studies = load_studies(settings, where)
    except UserError:
        if not isinstance(entries, Mapping):
            raise
        kept = {name: entries[name] for name in entries if _loads(found, settings, name, where)}
        if not kept:
            raise
        sound = {**settings, "studies": kept}
        studies = load_studies(sound, where)
    _keep_with_data(found, studies)
    _load_populations(found, sound, where)
    return found


def _loads(found: CheckedConfig, settings: Mapping[str, Any], name: str, where: str) -> bool:
    """Whether a study has no fault in its settings; a fault of the config itself is raised."""
    alone = {key: value for key, value in settings.items() if key != "populations"}
    try:
        load_studies({**alone, "studies": {name: settings["studies"][name]}}, where)
    except UserError as error:
        faults = str(error).splitlines()
        if not all(f"studies.{name}" in fault for fault in faults):
            raise
        found.faults[name] = faults
    return name not in found.faults


def _keep_with_data(found: CheckedConfig, studies: Iterable[Study]) -> None:
    folders: dict[str, list[str]] = {}
    for study in studies:
        try:
            missing = missing_data(study.specimen, study.data_root)
        except UserError as error:
            found.faults[study.name] = str(error).splitlines()
            continue
        if missing:
            folders.setdefault(missing, []).append(study.name)
        else:
            found.studies[study.name] = study
    for missing, names in folders.items():
        few = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} like it"
        found.left_out.append(f"{few} left out: {missing}")
        found.without_data |= dict.fromkeys(names, missing)


def _load_populations(found: CheckedConfig, settings: Mapping[str, Any], where: str) -> None:
    """Load the populations whose studies have no fault in their settings."""
    entries = settings.get("populations") or {}
    kept = {}
    for name, entry in entries.items():
        at_fault = [study for study in entry.get("studies", ()) if study in found.faults]
        if at_fault:
            found.left_out.append(_lacks(name, at_fault, "have faults"))
        else:
            kept[name] = entry
    for population in load_populations({**settings, "populations": kept}, where) if kept else ():
        found.populations[population.name] = population
    _drop_populations(found)


def _lacks(population: str, studies: Iterable[str], why: str) -> str:
    return f"population {population} left out: its studies {', '.join(studies)} {why}"


def _drop_populations(found: CheckedConfig) -> None:
    """Leave out the populations of which a study is left out."""
    for name, population in list(found.populations.items()):
        missing = [study for study in population.studies if study not in found.studies]
        if missing:
            del found.populations[name]
            at_fault = any(study in found.faults for study in missing)
            why = "have faults" if at_fault else "have no records here"
            found.left_out.append(_lacks(name, missing, why))


def check_config(found: CheckedConfig, results: Path) -> None:
    """Move the studies and populations with a fault to `faults`; their names are checked.

    Parameters
    ----------
    results : folder of the results, which `prior_from` names.
    """
    by_study = {name: _faults_of_names(study) for name, study in found.studies.items()}
    _drop(found, {name: faults for name, faults in by_study.items() if faults})
    for name, population in list(found.populations.items()):
        if faults := check_population(population, found.studies):
            del found.populations[name]
            found.faults[f"{FOLDER}/{name}"] = faults
    while at_fault := _prior_faults(found, results):
        _drop(found, at_fault)


def _faults_of_names(study: Study) -> list[str]:
    """Return what `check_names` finds, and files that may not be read."""
    report = Report()
    try:
        with report.catching():
            report.include(check_names(study))
    except OSError as error:
        if error.filename is None:
            raise
        report.fault(f"{error.strerror}; it must be there for you to read", str(error.filename))
    return report.faults


def _drop(found: CheckedConfig, at_fault: Mapping[str, list[str]]) -> None:
    """Move studies to `faults`, and leave out the populations that they are in."""
    for name in at_fault:
        del found.studies[name]
    found.faults |= at_fault
    _drop_populations(found)


def _prior_faults(found: CheckedConfig, results: Path) -> dict[str, list[str]]:
    """Return the faults in `prior_from`, by study."""
    sources = Sources(
        found.studies, found.populations, results, found.without_data, tuple(found.faults)
    )
    faults = {name: sources.faults(study) for name, study in found.studies.items()}
    return {name: of_study for name, of_study in faults.items() if of_study}


def only_asked(found: CheckedConfig, targets: Collection[str], results: Path) -> bool:
    """Keep the studies to which targets belong, and those whose posteriors they need.

    Returns whether all targets are of studies or populations; if not, everything is kept.

    Raises
    ------
    Faults : targets of a study that the config does not have, or that has no records here.
    """
    owners = {target: owner_of(target, results) for target in targets}
    if not owners or None in owners.values():
        return False
    known = {*found.studies, *found.faults, *(f"{FOLDER}/{name}" for name in found.populations)}
    unknown = {
        target: owner
        for target, owner in owners.items()
        if owner not in known and not _is_part_of_faulty(found, str(owner))
    }
    if unknown:
        raise Faults([_why_unknown(found, *each, known) for each in unknown.items()])
    wanted = _with_sources(found, [owner for owner in owners.values() if owner], results)
    found.studies = {name: found.studies[name] for name in found.studies if name in wanted}
    found.populations = {
        name: found.populations[name] for name in found.populations if f"{FOLDER}/{name}" in wanted
    }
    found.faults = {
        name: found.faults[name]
        for name in found.faults
        if any(owner == name or owner.startswith(f"{name}_") for owner in wanted)
    }
    found.left_out.clear()
    return True


def owner_of(target: str, results: Path) -> str | None:
    """Name of the study, or `populations/NAME`, to which a result belongs; None for others."""
    place = Path(target)
    if not place.is_relative_to(results):
        return None
    parts = place.relative_to(results).parts
    if not parts or parts[0] in (REPORT, LOGS):
        return None
    return "/".join(parts[:2]) if parts[0] == FOLDER else parts[0]


def _is_part_of_faulty(found: CheckedConfig, owner: str) -> bool:
    """Whether a name may be that of a part of a faulty study with `split_by`."""
    return any(owner.startswith(f"{name}_") for name in found.faults)


def _why_unknown(
    found: CheckedConfig, target: str, owner: str | None, known: Collection[str]
) -> str:
    if owner in found.without_data:
        return f"{target}: study {owner} is left out: {found.without_data[owner]}"
    return f"{target}: there is no study {owner!r}{nearest(owner, known)}"


def _with_sources(found: CheckedConfig, owners: list[str], results: Path) -> set[str]:
    """Names of studies and populations, and of those whose posteriors they need."""
    wanted: set[str] = set()
    while owners:
        name = owners.pop()
        if name in wanted:
            continue
        wanted.add(name)
        population = found.populations.get(name.removeprefix(f"{FOLDER}/"))
        if name.startswith(f"{FOLDER}/") and population is not None:
            owners += population.studies
        source = found.studies[name].prior_from if name in found.studies else None
        owners += filter(None, [owner_of(source, results) if source else None])
    return wanted
