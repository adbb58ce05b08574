"""Read and check a study folder: specimen.yaml, experiments.csv and the records."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from deabayes.experiment import FloatArray, Specimen
from deabayes.faults import Faults, UserError, closest
from deabayes.records.columns import CHANNELS, ExperimentRow, RawRecord, from_text
from deabayes.records.download import PublicRecord, locate, missing_sentence, read_registry
from deabayes.records.excitation import value_before
from deabayes.records.record import hidden_excitation, read_record, without_incomplete
from deabayes.records.record_checks import needed_columns, record_faults, record_warnings
from deabayes.records.schema import read_yaml
from deabayes.records.specimen import SpecimenFile, read_specimen_file
from deabayes.records.table import FILE, channels_of, measured_rows, scan_table


def repeated_records(records: Iterable[tuple[ExperimentRow, RawRecord]], where: str) -> list[str]:
    """Faults: rows with the values of another record, unless neither is fitted.

    The phase that belongs to a gain counts as a record, too.
    """
    every = [
        (row, each, raw.columns[each.response])
        for row, raw in records
        for each in measured_rows(row, raw)
        if each.response in raw.columns
    ]
    every.sort(key=lambda found: (found[0] is found[1], found[1].role != "calibrate"))
    seen: dict[str, tuple[ExperimentRow, ExperimentRow]] = {}
    faults: dict[str, str] = {}
    for row, each, values in every:
        gain, first = seen.setdefault(_digest(values), (row, each))
        fitted = "calibrate" in (first.role, each.role)
        if first.name != each.name and fitted:  # `_repeated` of table.py reports repeated names
            brought = first is not gain and each is row
            said = _brought(each, first, gain) if brought else _same(each, first)
            faults[row.name] = f"{where}: {said}"
    return list(faults.values())


def taken_names(records: Sequence[tuple[ExperimentRow, RawRecord]], where: str) -> list[str]:
    """Faults: rows named like the phase that belongs to a gain."""
    own = {row.name.lower(): row.name for row, _ in records}
    return [
        f"{where}: row {own[phase.name.lower()]!r} has the name of the phase that row {row.name!r} "
        "brings with its gain; rename it, or remove it if it is that phase"
        for row, raw in records
        for phase in measured_rows(row, raw)[1:]
        if phase.name.lower() in own
    ]


def _digest(values: FloatArray) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()


def _same(row: ExperimentRow, first: ExperimentRow) -> str:
    twice = ", and would count twice" if row.role == first.role else ""
    return (
        f"{row.role} record {row.name!r} holds the same values as {first.role} record "
        f"{first.name!r}{twice}; give it another measurement, or remove the row"
    )


def _brought(row: ExperimentRow, phase: ExperimentRow, gain: ExperimentRow) -> str:
    return (
        f"{row.role} record {row.name!r} is the phase that {gain.role} record {gain.name!r} "
        f"brings with its gain, as {phase.name!r}; remove the row {row.name!r}"
    )


KEPT_BYTES = 200e6
"""Records stay in memory up to this size, so that checking and preparing read them only once."""


@dataclass(frozen=True)
class StudyFolder:
    """A user's study folder: the specimen, the rows of experiments.csv, and their records.

    `specimen` and `table` are already checked; `record` reads and checks a record.
    """

    path: Path
    file: SpecimenFile
    table: tuple[ExperimentRow, ...]
    data_root: Path | None = None
    _kept: dict[str, RawRecord] = field(default_factory=dict, repr=False, compare=False)

    @property
    def specimen(self) -> Specimen:
        """The tested specimen."""
        return self.file.specimen

    def locate(self, row: ExperimentRow) -> Path | None:
        """The record's file in study folder, $DEABAYES_DATA, `data_root` or cache; else None."""
        return locate(row.record, self.path, self.file.download, self.data_root)

    def record(self, row: ExperimentRow) -> RawRecord:
        """Return the row's record in SI units.

        Raises
        ------
        Faults, UserError : the file cannot be read, or its values cannot be used.
        """
        if row.name in self._kept:
            return self._kept[row.name]
        raw = self.read(row)
        where = self._where(row)
        found = [record_faults(e, raw, self.specimen, where) for e in measured_rows(row, raw)]
        if faults := dict.fromkeys(fault for each in found for fault in each):
            raise Faults(list(faults))
        used = sum(a.nbytes for r in self._kept.values() for a in r.columns.values())
        if used + sum(a.nbytes for a in raw.columns.values()) < KEPT_BYTES:
            self._kept[row.name] = raw
        return raw

    def read(self, row: ExperimentRow) -> RawRecord:
        """Return the row's record with unchecked values."""
        path = self.locate(row)
        if path is None:
            raise UserError(self._missing_file(row))
        text = row.metadata.get("columns")
        columns = from_text(text) if isinstance(text, str) else None
        raw = read_record(path, self.file.record_format, self._channels(row), columns)
        if (self.file.record_format or {}).get("incomplete_rows") != "drop":
            return raw
        needed = [name for each in measured_rows(row, raw) for name in needed_columns(each)]
        before = value_before(row, self.specimen.system)
        if hidden := hidden_excitation(row, raw, needed, before, self._where(row)):
            raise Faults(hidden)
        return without_incomplete(raw, needed)

    def warnings(self, row: ExperimentRow) -> list[str]:
        """Warnings that a user must know before trusting a row's record."""
        raw = self.record(row)
        found = record_warnings(row, raw, self.specimen, self._where(row))
        published = self._published().get(row.record)
        if published is not None and published.sha256 != raw.sha256:
            found.append(f"{self._where(row)}: differs from the published file (SHA-256)")
        return found

    def faults(self, rows: Sequence[ExperimentRow] | None = None) -> list[str]:
        """Every fault of the rows' records, and of the rows together."""
        rows = self.table if rows is None else rows
        found = self.missing(rows)
        sound = []
        for row in rows:
            if self.locate(row) is None:
                continue
            try:
                sound.append((row, self.record(row)))
            except Faults as error:
                found += error.faults
            except UserError as error:
                found.append(str(error))
        table = str(self.path / FILE)
        return found + repeated_records(sound, table) + taken_names(sound, table)

    def missing(self, rows: Sequence[ExperimentRow]) -> list[str]:
        """Messages about rows whose record's file is missing."""
        lost = [row for row in rows if self.locate(row) is None]
        if lost and self.file.download is not None:
            names = [row.record for row in lost]
            return [missing_sentence(self.path, self.file.download, names, len(rows))]
        return [self._missing_file(row) for row in lost]

    def _channels(self, row: ExperimentRow) -> Mapping[str, str]:
        try:
            excitations, responses = channels_of(self.specimen.system, row.protocol)
        except UserError:  # other checks report a wrong system name
            return CHANNELS
        return {**CHANNELS, **excitations, **responses}

    def _where(self, row: ExperimentRow) -> str:
        return f"{self.locate(row) or self.path / row.record} ({row.name})"

    def _published(self) -> dict[str, PublicRecord]:
        download = self.file.download
        return {} if download is None else read_registry(self.path / download["registry"])

    def _missing_file(self, row: ExperimentRow) -> str:
        """Message about a missing file, with a similar name as a hint.

        Names are compared without their endings, because equal endings make any two names
        similar.
        """
        place = f"{self.path / row.record} ({row.name})"
        if (self.path / row.record).is_dir():
            return f"{place}: is a folder, not a record; correct {FILE}"
        path = self.path / row.record.replace("\\", "/")  # as written on Windows
        files = path.parent.iterdir() if path.parent.is_dir() else ()
        names = {p.stem: p.name for p in sorted(files, key=lambda p: p.suffix == path.suffix)}
        meant = closest(path.stem, names)
        record = path.with_name(names[meant]).relative_to(self.path).as_posix() if meant else ""
        hint = f"; did you mean {record!r}?" if record else ""
        return f"{place}: there is no such file; put it there or correct {FILE}{hint}"


def read_folder(
    folder: Path, data_root: Path | None = None, check_records: bool = True
) -> StudyFolder:
    """Read and check a study folder.

    Parameters
    ----------
    folder : holds specimen.yaml and experiments.csv.
    data_root : local copy of the public data sets; $DEABAYES_DATA has priority.
    check_records : whether to read and check every record; else `StudyFolder.record` does.

    Raises
    ------
    Faults : every fault of specimen.yaml, experiments.csv and the records.
    """
    read, faults = scan_folder(folder, data_root, check_records)
    if faults or read is None:
        raise Faults(faults)
    return read


def scan_folder(
    folder: Path, data_root: Path | None = None, check_records: bool = True
) -> tuple[StudyFolder | None, list[str]]:
    """Read as much of a study folder as possible, and return it with every fault."""
    folder = Path(folder)
    if folder.is_file():
        return None, [f"{folder}: is a file; name its folder {_study_of(folder)}"]
    if not folder.is_dir():
        return None, [f"{folder}: there is no such folder; `deabayes new` makes one to fill in"]
    faults: list[str] = []
    file = _specimen_file(folder, faults)
    system = file.specimen.system if file is not None and file.specimen.system else None
    rows, wrong = scan_table(folder, system)
    faults += wrong
    if file is None:
        return None, faults
    read = StudyFolder(folder, file, tuple(rows), data_root)
    return read, faults + (read.faults() if check_records else [])


def _study_of(file: Path) -> Path:
    """Return the study folder above a file at any depth; else the file's own folder."""
    above = (each for each in file.parents if (each / "specimen.yaml").is_file())
    return next(above, file.parent)


def _specimen_file(folder: Path, faults: list[str]) -> SpecimenFile | None:
    """Read specimen.yaml; if faulty, return only what checks of the records need."""
    try:
        return read_specimen_file(folder)
    except UserError as error:
        found = list(error.faults) if isinstance(error, Faults) else [str(error)]
    faults += found
    if any("record_format" in fault or "download" in fault for fault in found):
        return None
    try:
        content = read_yaml(folder / "specimen.yaml")
    except UserError:
        return None
    known = not any(", system" in fault for fault in found)
    system = content.get("system") if known else None
    specimen = Specimen(str(content.get("name")), system if isinstance(system, str) else "", {}, {})
    given = content.get("record_format"), content.get("download")
    return SpecimenFile(specimen, *given, sound=False)
