"""Checks of `prior_from` against the studies and records of a config."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from deabayes.api import open_posterior
from deabayes.checks.priors import overruled
from deabayes.checks.study import used_rows
from deabayes.faults import Report, UserError, nearest
from deabayes.inference.default_priors import wider_systems
from deabayes.population.settings import FOLDER, Population
from deabayes.posteriors.inheritance import Inheritance, foreign_quantities, inherit_from
from deabayes.posteriors.records import CountedRecord, counted_records, counted_twice
from deabayes.posteriors.storage import read_tree
from deabayes.prior.overrides import check_same_order
from deabayes.records.folder import read_folder
from deabayes.records.record import sha256_of
from deabayes.records.specimen import read_specimen
from deabayes.study import Study
from deabayes.systems import System, build

SourceOf = Callable[[str], tuple[Study, ...] | Path]
"""What `prior_from` names: studies of the config (for a population all of its), else a file."""


def repeated_in_prior(study: Study, source_of: SourceOf) -> list[str]:
    """Return a sentence on each record that would count twice."""
    if study.prior_from is None:
        return []
    known = list(_known(study.prior_from, source_of, set()))
    return counted_twice(study.name, _calibrated(study), known, study.prior_from)


def _known(source: str, source_of: SourceOf, passed: set[str]) -> Iterator[CountedRecord]:
    """Yield the records behind a posterior, even if it is not fitted yet; each source once."""
    found = source_of(source)
    if source in passed:
        return
    passed.add(source)
    if isinstance(found, Path):
        if found.is_file():
            yield from counted_records(read_tree(found, ()))
        return
    for study in found:
        yield from _calibrated(study)
        if study.prior_from is not None:
            yield from _known(study.prior_from, source_of, passed)


def _calibrated(study: Study) -> list[CountedRecord]:
    """Return a study's calibration records by their files; other checks report missing files."""
    try:
        read = read_folder(study.specimen, study.data_root, check_records=False)
    except UserError:
        return []
    rows = [row for row in used_rows(study, read, Report()) if row.role == "calibrate"]
    files = [(row, read.locate(row)) for row in rows]
    return [
        CountedRecord(study.name, row.name, row.response, sha256_of(path))
        for row, path in files
        if path is not None
    ]


POSTERIOR = "posterior.nc"


@dataclass(frozen=True)
class Sources:
    """The posteriors that the studies of a config can use as their prior.

    Attributes
    ----------
    studies, populations : those of the config by name, without faults of their own.
    results : folder of their results.
    left_out : other studies of the config, whose records are not on this machine.
    faulty : studies of the config that have faults of their own.
    """

    studies: Mapping[str, Study]
    populations: Mapping[str, Population]
    results: Path = Path("results")
    left_out: Collection[str] = field(default_factory=tuple)
    faulty: Collection[str] = field(default_factory=tuple)

    def faults(self, study: Study) -> list[str]:
        """Faults of the source that a study names in `prior_from`.

        The source does not exist, depends on this study, does not fit a candidate, or was fitted
        to a record that the study calibrates on.
        """
        if study.prior_from is None:
            return []
        try:
            names = self._handed_on(study.prior_from)
        except UserError as error:
            return [f"study {study.name}, prior_from: {line}" for line in str(error).splitlines()]
        faults = self._circle(study)
        for candidate in study.candidates:
            misfit = _misfit(study, candidate, names)
            faults += [f"study {study.name}, {candidate}, {misfit}"] if misfit else []
        return faults or repeated_in_prior(study, self._behind)

    def cautions(self, study: Study) -> list[str]:
        """Return warnings about the posterior of `prior_from`, even if it is not fitted yet."""
        if study.prior_from is None:
            return []
        if Path(study.prior_from).is_file():
            found = inherit_from(Path(study.prior_from), read_specimen(study.specimen))
            lines = [*(f"prior_from: {doubt}" for doubt in found.doubts), *found.notes]
            lines += _overruled(study, found.prior.names, found)
        else:
            lines = self._overruled_later(study, study.prior_from)
        return [f"study {study.name}, {line}" for line in lines]

    def _overruled_later(self, study: Study, source: str) -> list[str]:
        """Return the result of `_overruled` for a posterior that is not fitted yet."""
        names, behind = self._handed_on(source), self._behind(source)
        if isinstance(behind, Path):
            return []
        first, candidate = behind[0], (self._named(source) or ("", ""))[1]
        if candidate in first.candidates:
            system, own = _system(first, candidate), read_specimen(study.specimen)
            stated = [name for name in names if name in system.stated()]
            foreign = foreign_quantities(stated, system.specimen, own)
            names = [name for name in names if name not in foreign]
        return _overruled(study, names, first)

    def _named(self, source: str | None) -> tuple[str, str] | None:
        """Return the (study, candidate), or (FOLDER, population), that a path belongs to."""
        if source is None or not Path(source).is_relative_to(self.results):
            return None
        parts = Path(source).relative_to(self.results).parts
        return (parts[0], parts[1]) if len(parts) == 3 and parts[2] == POSTERIOR else None

    def _handed_on(self, source: str) -> Sequence[str]:
        """Return the parameters that a posterior provides, even if it is not fitted yet."""
        named = self._named(source)
        if named is not None and named[0] == FOLDER and named[1] in self.populations:
            return self.populations[named[1]].parameters
        if named is not None and named[0] in self.studies:
            study = self.studies[named[0]]
            if named[1] in study.candidates:
                return [parameter.name for parameter in _system(study, named[1]).parameters()]
        if Path(source).exists():  # `open_posterior` reports a folder
            return open_posterior(source).as_prior().names
        raise UserError(f"{source}: {self._why_missing(named)}")

    def _behind(self, source: str) -> tuple[Study, ...] | Path:
        """Return the studies of the config whose records a posterior includes, else its file."""
        name, candidate = self._named(source) or ("", "")
        if name == FOLDER and candidate in self.populations:
            return tuple(self.studies[each] for each in self.populations[candidate].studies)
        return (self.studies[name],) if name in self.studies else Path(source)

    def _why_missing(self, named: tuple[str, str] | None) -> str:
        if named is None:
            return "there is no such file; correct the path, or fit that study first"
        name, candidate = named
        if name == FOLDER:
            return f"{candidate!r} is no population{nearest(candidate, self.populations)}"
        if name in self.left_out:
            return f"study {name!r} is left out, as its records are not on this machine"
        if name in self.faulty:
            return f"study {name!r} has a fault of its own; correct that one first"
        if name not in self.studies:
            return f"{name!r} is no study{nearest(name, self.studies)}"
        known = self.studies[name].candidates
        return f"study {name!r} has no candidate {candidate!r}{nearest(candidate, known)}"

    def _after(self, name: str) -> Sequence[str]:
        """Return the studies and populations (`populations/NAME`) that must be fitted first."""
        if name.startswith(f"{FOLDER}/"):
            population = self.populations.get(name.removeprefix(f"{FOLDER}/"))
            return () if population is None else population.studies
        named = self._named(self.studies[name].prior_from) if name in self.studies else None
        if named is None:
            return ()
        return (f"{FOLDER}/{named[1]}",) if named[0] == FOLDER else (named[0],)

    def _circle(self, study: Study) -> list[str]:
        """Return one fault for studies that wait for each other, the same for all of them."""
        circle = self._way_back(study.name)
        # The population's check reports a member that uses it as prior.
        if not circle or (len(circle) == 2 and circle[1].startswith(f"{FOLDER}/")):
            return []
        first = circle.index(min(circle))
        ring = [*circle[first:], *circle[:first], circle[first]]
        chain = ", ".join(f"{a} from {b}" for a, b in pairwise(ring))
        return [f"prior_from: {chain}: no posterior can be its own prior; take one of them out"]

    def _way_back(self, start: str) -> list[str]:
        """Return the names on the way from `start` back to itself; empty if there is none."""
        ways, passed = [[start]], set[str]()
        while ways:
            way = ways.pop()
            for each in self._after(way[-1]):
                if each == start:
                    return way
                if each not in passed:
                    passed.add(each)
                    ways.append([*way, each])
        return []


def _overruled(study: Study, handed_on: Collection[str], theirs: Study | Inheritance) -> list[str]:
    """Warn of `priors:` entries that do not act as priors, once for all candidates."""
    systems = [_system(study, candidate) for candidate in study.candidates]
    every = [overruled(study, each, handed_on, theirs.priors) for each in systems]
    return list(dict.fromkeys(line for lines in every for line in lines))


def _misfit(study: Study, candidate: str, names: Sequence[str]) -> str:
    """Say why a candidate cannot take these parameters over; empty if it can."""
    system = _system(study, candidate)
    wider = [_names(each) for each in wider_systems(study, system).values()]
    if not _names(system) & set(names) and any(each & set(names) for each in wider):
        return ""  # a prior of parameters that only predictions need
    try:
        check_same_order(system.parameters(), names)
    except UserError as error:
        return str(error)
    return ""


def _system(study: Study, candidate: str) -> System:
    specimen = read_specimen(study.specimen)
    return build(specimen.system, candidate, specimen)


def _names(system: System) -> set[str]:
    return {parameter.name for parameter in system.parameters()}
