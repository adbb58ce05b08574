"""Check a study folder, and report what was read and every fault."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.checks.study import without_candidate
from deabayes.faults import Faults, UserError
from deabayes.quantities import display_unit, short, with_unit
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import StudyFolder, scan_folder

if TYPE_CHECKING:
    from deabayes.experiment import FloatArray, Quantity


@dataclass(frozen=True)
class CheckReport:
    """The result of checking a study folder.

    Attributes
    ----------
    folder : the study folder.
    understood : lines on the specimen, its quantities and every readable record.
    faults : what the user must correct.
    warnings : what the user must know.
    """

    folder: Path
    understood: tuple[str, ...]
    faults: tuple[str, ...]
    warnings: tuple[str, ...]

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


def check_folder(folder: Path, data_root: Path | None = None, as_study: bool = True) -> CheckReport:
    """Check specimen.yaml, experiments.csv and all records, without raising user errors.

    Parameters
    ----------
    as_study : whether to add the faults and warnings of a study of all records.
    """
    read, faults = scan_folder(Path(folder), data_root)
    if read is None:
        return CheckReport(Path(folder), (), tuple(faults), ())
    faults += without_candidate(read)
    understood = _specimen_lines(read)
    warnings = [*_wide(read), *_left_to_fill_in(read)]
    for row in read.table:
        lines, found = _record_lines(read, row)
        understood += lines
        warnings += found
    if as_study and not faults:
        more_faults, more_warnings = _as_studied(read, data_root)
        faults, warnings = [*faults, *more_faults], [*warnings, *more_warnings]
    return CheckReport(Path(folder), tuple(understood), tuple(faults), tuple(warnings))


def _as_studied(read: StudyFolder, data_root: Path | None) -> tuple[list[str], list[str]]:
    """Check a study of all records, with the first candidate that can model them.

    Its model may have to be compiled.
    """
    from deabayes.checks.study import check_study
    from deabayes.study import Study
    from deabayes.systems import OWN, candidates

    system = read.specimen.system
    for candidate in () if system in OWN else candidates(system):
        study = Study(read.path.name, read.path, (candidate,), data_root=data_root)
        faults, warnings = check_study(study, compare=True)
        said = f"study {study.name}, "
        if any(f.startswith((f"{said}{candidate}", f"{said}candidates")) for f in faults):
            continue
        return [f.removeprefix(said) for f in faults], [w.removeprefix(said) for w in warnings]
    return [], []


def _specimen_lines(read: StudyFolder) -> list[str]:
    specimen = read.specimen
    kind = specimen.provenance.get("kind", "unknown provenance")
    lines = [f"{specimen.name}: {specimen.system or 'unknown system'}, {kind}"]
    lines += [f"  {_shown(name, q)}" for name, q in specimen.quantities.items()]
    lines += [f"  instrument {_shown(name, q)}" for name, q in specimen.instruments.items()]
    return lines


def _wide(read: StudyFolder) -> list[str]:
    """Warn of quantities whose sd seems to be in per cent or in another unit."""
    ratios = {name: q.sd / abs(q.value) for name, q in read.specimen.quantities.items() if q.sd}
    return [
        f"{read.path}/specimen.yaml, quantities.{name}: its sd is {ratio:.3g} times its value; an "
        "sd is in the value's unit, not in per cent"
        for name, ratio in ratios.items()
        if ratio > 1.0
    ]


def _left_to_fill_in(read: StudyFolder) -> list[str]:
    """Warn of placeholders from `deabayes new` that nobody replaced."""
    texts = {f"provenance.{key}": text for key, text in read.specimen.provenance.items()}
    for kind in ("quantities", "instruments"):
        for name, quantity in getattr(read.specimen, kind).items():
            texts[f"{kind}.{name}.source"] = quantity.source
    return [
        f"{read.path}/specimen.yaml, {key}: is '...', as `deabayes new` writes it; fill it in, or "
        "remove the key"
        for key, text in texts.items()
        if text.strip() in ("...", "…")
    ]


def _shown(name: str, quantity: Quantity) -> str:
    unit = display_unit(quantity.unit, quantity.value, name)
    value = f"{quantity.value / unit.factor:.6g}"
    if quantity.sd is None:
        return f"{name} = {value}{unit.behind} (exact)"
    return f"{name} = {value} ± {short(quantity.sd / unit.factor, 2)}{unit.behind} (a parameter)"


def _record_lines(read: StudyFolder, row: ExperimentRow) -> tuple[list[str], list[str]]:
    """Return lines that describe one record, and its warnings; one note if it has faults."""
    title = f"{row.name}: {row.protocol}, {row.role}, {row.excitation} -> {row.response}"
    try:
        raw, warnings = read.record(row), read.warnings(row)
    except (Faults, UserError):
        return ["", f"{title} (cannot be used, see the faults)"], []
    extra = ", ".join(f"{key} {value}" for key, value in row.metadata.items())
    lines = ["", title, f"  {read.locate(row)}", f"  {_sampling(raw)}"]
    lines += [f"  {name} {_extent(name, values, raw.units[name])}"
              for name, values in raw.columns.items()]  # fmt: skip
    return lines + ([f"  {extra}"] if extra else []), warnings


def _extent(name: str, values: FloatArray, unit: str) -> str:
    shown = display_unit(unit, values, name)
    low, high = values.min() / shown.factor, values.max() / shown.factor
    return f"from {low:.6g} to {high:.6g}{shown.behind}"


def _sampling(raw: RawRecord) -> str:
    rows = next(iter(raw.columns.values())).size
    if "time" not in raw.columns:
        return f"{rows} rows"
    time = raw.columns["time"]
    rate = with_unit(1.0 / float(np.median(np.diff(time))), "Hz", digits=4)
    return f"{rows} rows, {with_unit(float(time[-1] - time[0]), 's')}, sampled at {rate}"
