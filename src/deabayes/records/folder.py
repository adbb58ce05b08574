"""Read and check a study folder: specimen.yaml, experiments.csv and the records."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from deabayes.experiment import Specimen
from deabayes.faults import Faults, Report, UserError, closest
from deabayes.records.channels import value_before
from deabayes.records.checks import checked, needed_columns
from deabayes.records.columns import CHANNELS, ExperimentRow, RawRecord, from_text
from deabayes.records.marks import confirm
from deabayes.records.record import hidden_excitation, locate, read_record, without_incomplete
from deabayes.records.specimen import SpecimenFile, read_content, read_specimen_file
from deabayes.records.table import FILE, channels_of, measured_rows, scan_table

KEPT_BYTES = 200e6
"""Records stay in memory up to this size, so that checking and preparing read them only once."""


@dataclass(frozen=True)
class StudyFolder:
    """A user's study folder: the specimen, the rows of experiments.csv, and their records.

    `record` reads and checks a record. `faults` are those of all files that were read so far.
    """

    path: Path
    file: SpecimenFile
    table: tuple[ExperimentRow, ...]
    data_root: Path | None = None
    faults: list[str] = field(default_factory=list, compare=False)
    _kept: dict[str, RawRecord] = field(default_factory=dict, repr=False, compare=False)

    @property
    def specimen(self) -> Specimen:
        """The tested specimen."""
        return self.file.specimen

    def locate(self, row: ExperimentRow) -> Path | None:
        """The record's file in study folder, $DEABAYES_DATA, `data_root` or cache; else None."""
        return locate(row.record, self.path, self.file.download, self.data_root)

    def record(self, row: ExperimentRow) -> RawRecord:
        """Return the row's record in SI units, with the warnings of its checks.

        Raises
        ------
        Faults, UserError : the file cannot be read, or its values cannot be used.
        """
        if row.name in self._kept:
            return self._kept[row.name]
        raw = checked(row, self.read(row), self.specimen, self.locate(row))
        if self._differs_from_published(row, raw):
            note = f"{row.record} ({row.name}): differs from the published file (SHA-256)"
            warnings = {**raw.warnings, row.name: (*raw.warnings[row.name], note)}
            raw = replace(raw, warnings=warnings)
        used = sum(a.nbytes for r in self._kept.values() for a in r.columns.values())
        if used + sum(a.nbytes for a in raw.columns.values()) < KEPT_BYTES:
            self._kept[row.name] = raw
        return raw

    def warnings(self, row: ExperimentRow) -> list[str]:
        """Warnings that a user must know before trusting a row's record, with its file's path."""
        warnings = self.record(row).warnings[row.name]
        return [f"{self.locate(row)}{w.removeprefix(row.record)}" for w in warnings]

    def read(self, row: ExperimentRow) -> RawRecord:
        """Return the row's record with unchecked values, without rows to be left out."""
        path = self.locate(row)
        if path is None:
            raise UserError(self._missing_file(row))
        text = row.metadata.get("columns")
        columns = from_text(text) if isinstance(text, str) else None
        raw = read_record(
            path, self.file.record_format, self._channels(row), columns, needed_columns(row)
        )
        if (self.file.record_format or {}).get("incomplete_rows") != "drop":
            return raw
        needed = [name for each in measured_rows(row, raw) for name in needed_columns(each)]
        before, report = value_before(row, self.specimen.system), Report(self._place(row))
        hidden_excitation(row, raw, needed, before, report)
        report.raise_faults()
        return without_incomplete(raw, needed)

    def check_records(self, report: Report) -> None:
        """Report every fault of the records, and of the rows together."""
        report.include(self.missing(self.table))
        sound = []
        for row in self.table:
            if self.locate(row) is not None:
                with report.catching():
                    sound.append((row, self.record(row)))
        repeated_records(sound, report.at(str(self.path / FILE)))
        _check_names_of_phases(sound, report.at(str(self.path / FILE)))

    def missing(self, rows: Sequence[ExperimentRow]) -> list[str]:
        """Messages about rows whose record's file is missing."""
        lost = [row for row in rows if self.locate(row) is None]
        if lost and self.file.download is not None:
            from deabayes.records.download import missing_sentence

            names = [row.record for row in lost]
            return [missing_sentence(self.path, self.file.download, names, len(rows))]
        return [self._missing_file(row) for row in lost]

    def _channels(self, row: ExperimentRow) -> Mapping[str, str]:
        try:
            excitations, responses = channels_of(self.specimen.system, row.protocol)
        except UserError:  # other checks report a wrong system name
            return CHANNELS
        return {**CHANNELS, **excitations, **responses}

    def _place(self, row: ExperimentRow) -> str:
        return f"{self.locate(row) or self.path / row.record} ({row.name})"

    def _differs_from_published(self, row: ExperimentRow, raw: RawRecord) -> bool:
        if self.file.download is None:
            return False
        from deabayes.records.download import read_registry

        published = read_registry(self.path / self.file.download["registry"]).get(row.record)
        return published is not None and published.sha256 != raw.sha256

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
    report = Report()
    read = scan_folder(folder, report, data_root, check_records)
    report.raise_faults()
    assert read is not None  # else the report has a fault
    return read


def scan_folder(
    folder: Path, report: Report, data_root: Path | None = None, check_records: bool = True
) -> StudyFolder | None:
    """Read as much of a study folder as possible, and report every fault."""
    folder = Path(folder)
    if folder.is_file():
        report.fault(f"{folder}: is a file; name its folder {_study_of(folder)}")
        return None
    if not folder.is_dir():
        report.fault(f"{folder}: there is no such folder; `deabayes new` makes one to fill in")
        return None
    found, read = Report(), None
    file = _specimen_file(folder, found)
    system = file.specimen.system if file is not None and file.specimen.system else None
    rows = scan_table(folder, found, system)
    if file is not None:
        read = StudyFolder(folder, file, tuple(rows), data_root, found.faults)
        if check_records:
            read.check_records(found)
    report.include(found.faults)
    return read


def _study_of(file: Path) -> Path:
    """Return the study folder above a file at any depth; else the file's own folder."""
    above = (folder for folder in file.parents if (folder / "specimen.yaml").is_file())
    return next(above, file.parent)


def _specimen_file(folder: Path, report: Report) -> SpecimenFile | None:
    """Read specimen.yaml; if faulty, return only what checks of the records need."""
    try:
        file = read_specimen_file(folder)
        report.include(file.guesses)
        return file
    except UserError as error:
        faults = error.faults if isinstance(error, Faults) else (str(error),)
    report.include(faults)
    if any("record_format" in fault or "download" in fault for fault in faults):
        return None
    try:
        content, guesses = read_content(folder)
    except UserError:
        return None
    known = not any(", system" in fault for fault in faults)
    system = content.get("system") if known else None
    specimen = Specimen(str(content.get("name")), system if isinstance(system, str) else "", {}, {})
    given = content.get("record_format"), content.get("download")
    if guesses:
        report.fault(f"{folder / 'specimen.yaml'}: {confirm(guesses)}")
    return SpecimenFile(specimen, *given, sound=False)


def repeated_records(records: Iterable[tuple[ExperimentRow, RawRecord]], report: Report) -> None:
    """Report rows with the values of another record, unless neither is fitted.

    The phase that belongs to a gain counts as a record, too.
    """
    measured = [
        (row, part, raw.columns[part.response])
        for row, raw in records
        for part in measured_rows(row, raw)
        if part.response in raw.columns
    ]
    measured.sort(key=lambda entry: (entry[0] is entry[1], entry[1].role != "calibrate"))
    first_with: dict[str, tuple[ExperimentRow, ExperimentRow]] = {}
    faults: dict[str, str] = {}
    for row, part, values in measured:
        digest = hashlib.sha256(values.tobytes()).hexdigest()
        gain, first = first_with.setdefault(digest, (row, part))
        if first.name == part.name or "calibrate" not in (first.role, part.role):
            continue  # `table.py` reports repeated names
        if first is not gain and part is row:
            faults[row.name] = (
                f"{row.role} record {row.name!r} is the phase that {gain.role} record "
                f"{gain.name!r} brings with its gain, as {first.name!r}; remove the row "
                f"{row.name!r}"
            )
            continue
        twice = ", and would count twice" if part.role == first.role else ""
        faults[row.name] = (
            f"{part.role} record {part.name!r} holds the same values as {first.role} record "
            f"{first.name!r}{twice}; give it another measurement, or remove the row"
        )
    for fault in faults.values():
        report.fault(fault)


def _check_names_of_phases(
    records: Sequence[tuple[ExperimentRow, RawRecord]], report: Report
) -> None:
    """Report rows named like the phase that belongs to a gain."""
    rows = {row.name.lower(): row.name for row, _ in records}
    for row, raw in records:
        for phase in measured_rows(row, raw)[1:]:
            if phase.name.lower() in rows:
                report.fault(
                    f"row {rows[phase.name.lower()]!r} has the name of the phase that row "
                    f"{row.name!r} brings with its gain; rename it, or remove it if it is that "
                    "phase"
                )
