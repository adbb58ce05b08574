"""Check a study folder, and report what was read and every fault."""

from __future__ import annotations

from collections.abc import Sized
from pathlib import Path
from typing import TYPE_CHECKING

from deabayes.checks.study import check_on_records, without_candidate
from deabayes.faults import Report, UserError
from deabayes.quantities import display_unit, short, with_unit
from deabayes.records.channels import usual_interval
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import StudyFolder, scan_folder

if TYPE_CHECKING:
    from deabayes.experiment import FloatArray, Quantity


class FolderReport(Report):
    """The result of checking a study folder.

    Attributes
    ----------
    folder : the study folder.
    read : what was read of it; None if its specimen.yaml cannot be read.
    understood : lines on the specimen, its quantities and every readable record.
    """

    def __init__(self, folder: Path, data_root: Path | None = None) -> None:
        super().__init__()
        self.folder = folder
        self.read = scan_folder(folder, self, data_root)
        self.understood: list[str] = []

    @property
    def ok(self) -> bool:
        """Whether the folder can be used."""
        return not self.faults

    def text(self, with_faults: bool = True, with_count: bool = True) -> str:
        """Return the report as plain text, with faults last, or without faults, and with counts."""
        parts = ["\n".join(self.understood)] if self.understood else []
        if self.warnings:
            parts.append("\n".join(["Warnings", *(f"  - {line}" for line in self.warnings)]))
        if self.faults and with_faults:
            parts.append("\n".join(["Faults", *(f"  - {line}" for line in self.faults)]))
        if with_count:
            parts.append(f"{counted(self.faults, self.warnings)} in {self.folder}")
        return "\n\n".join(parts)


def counted(faults: Sized, warnings: Sized) -> str:
    """Return the numbers of faults and warnings: ``1 fault, 2 warnings``."""
    kinds = ((faults, "fault"), (warnings, "warning"))
    return ", ".join(f"{len(found)} {kind}{'s' * (len(found) != 1)}" for found, kind in kinds)


def check_folder(
    folder: Path, data_root: Path | None = None, as_study: bool = True
) -> FolderReport:
    """Check specimen.yaml, experiments.csv and all records, without raising user errors.

    Parameters
    ----------
    as_study : whether to add the faults and warnings of a study of all records.
    """
    report = FolderReport(Path(folder), data_root)
    if report.read is None:
        return report
    without_candidate(report.read, report)
    report.understood += _specimen_lines(report.read)
    _warn_of_specimen(report.read, report.at(f"{folder}/specimen.yaml"))
    for row in report.read.table:
        report.understood += _record_lines(report.read, row, report)
    if as_study and not report.faults:
        _check_as_study(report.read, report)
    return report


def _check_as_study(read: StudyFolder, report: Report) -> None:
    """Check a study of all records, with the first candidate that can model them.

    Its model may have to be compiled.
    """
    from deabayes.study import Study
    from deabayes.systems import OWN, candidates

    system = read.specimen.system
    for candidate in () if system in OWN else candidates(system):
        study, found = Study(read.path.name, read.path, (candidate,)), Report()
        check_on_records(study, read, found, compare=True)
        if not any(fault.startswith((candidate, "candidates")) for fault in found.faults):
            report.include(found.faults, found.warnings)
            return


def _specimen_lines(read: StudyFolder) -> list[str]:
    specimen = read.specimen
    kind = specimen.provenance.get("kind", "unknown provenance")
    lines = [f"{specimen.name}: {specimen.system or 'unknown system'}, {kind}"]
    lines += [f"  {_shown(name, q)}" for name, q in specimen.quantities.items()]
    lines += [f"  instrument {_shown(name, q)}" for name, q in specimen.instruments.items()]
    return lines


def _warn_of_specimen(read: StudyFolder, report: Report) -> None:
    """Warn of an sd that seems to be in per cent or another unit, and of placeholders left."""
    specimen = read.specimen
    for name, quantity in specimen.quantities.items():
        ratio = (quantity.sd or 0.0) / abs(quantity.value)
        if ratio > 1.0:
            report.warn(
                f"its sd is {ratio:.3g} times its value; an sd is in the value's unit, not in per "
                "cent",
                f"quantities.{name}",
            )
    texts = {f"provenance.{key}": text for key, text in specimen.provenance.items()}
    for kind in ("quantities", "instruments"):
        for name, quantity in getattr(specimen, kind).items():
            texts[f"{kind}.{name}.source"] = quantity.source
    for key, text in texts.items():
        if text.strip() in ("...", "…"):
            report.warn("is '...', as `deabayes new` writes it; fill it in, or remove the key", key)


def _shown(name: str, quantity: Quantity) -> str:
    unit = display_unit(quantity.unit, quantity.value, name)
    value = f"{quantity.value / unit.factor:.6g}"
    if quantity.sd is None:
        return f"{name} = {value}{unit.behind} (exact)"
    return f"{name} = {value} ± {short(quantity.sd / unit.factor, 2)}{unit.behind} (a parameter)"


def _record_lines(read: StudyFolder, row: ExperimentRow, report: Report) -> list[str]:
    """Return lines that describe one record, and add its warnings; one note if it has faults."""
    title = f"{row.name}: {row.protocol}, {row.role}, {row.excitation} -> {row.response}"
    try:
        raw = read.record(row)
    except UserError:
        return ["", f"{title} (cannot be used, see the faults)"]
    report.include(warnings=read.warnings(row))
    lines = ["", title, f"  {read.locate(row)}", f"  {_sampling(raw)}"]
    lines += [f"  {note}" for note in raw.notes]
    for name, values in raw.columns.items():
        lines.append(f"  {name} {_extent(name, values, raw.units[name])}")
    extra = ", ".join(f"{key} {value}" for key, value in row.metadata.items() if key != "columns")
    return lines + ([f"  {extra}"] if extra else [])


def _extent(name: str, values: FloatArray, unit: str) -> str:
    shown = display_unit(unit, values, name)
    low, high = values.min() / shown.factor, values.max() / shown.factor
    return f"from {low:.6g} to {high:.6g}{shown.behind}"


def _sampling(raw: RawRecord) -> str:
    rows = next(iter(raw.columns.values())).size
    if "time" not in raw.columns:
        return f"{rows} rows"
    time = raw.columns["time"]
    rate = with_unit(1.0 / usual_interval(time), "Hz", digits=4)
    return f"{rows} rows, {with_unit(float(time[-1] - time[0]), 's')}, sampled at {rate}"
