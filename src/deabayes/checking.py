"""What was understood of a study folder, and everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.faults import Faults, UserError, nearest
from deabayes.reading.checks import shorter_than_time_constant, too_few_points
from deabayes.reading.folder import StudyFolder, scan_folder
from deabayes.reading.raw import ExperimentRow, RawRecord
from deabayes.reading.record_checks import repeated_records

if TYPE_CHECKING:
    from deabayes.experiment import Quantity, Role
    from deabayes.study import Study
    from deabayes.systems import System


@dataclass(frozen=True)
class CheckReport:
    """The result of checking a study folder.

    Attributes
    ----------
    understood : lines on the specimen, its quantities and every readable record.
    faults : what must be corrected.
    warnings : what must be known.
    """

    folder: Path
    understood: tuple[str, ...]
    faults: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the folder can be used."""
        return not self.faults

    def text(self, with_faults: bool = True) -> str:
        """The report in plain text; faults last, or left out for standard error."""
        parts = ["\n".join(self.understood)] if self.understood else []
        if self.warnings:
            parts.append("\n".join(["Warnings", *(f"  - {line}" for line in self.warnings)]))
        if self.faults and with_faults:
            parts.append("\n".join(["Faults", *(f"  - {line}" for line in self.faults)]))
        parts.append(f"{len(self.faults)} faults, {len(self.warnings)} warnings in {self.folder}")
        return "\n\n".join(parts)


def check_folder(folder: Path, data_root: Path | None = None) -> CheckReport:
    """Check specimen.yaml, experiments.csv and all records; never raises for a user's mistake."""
    read, faults = scan_folder(Path(folder), data_root)
    if read is None:
        return CheckReport(Path(folder), (), tuple(faults), ())
    understood = _specimen_lines(read)
    warnings: list[str] = []
    for row in read.table:
        lines, found = _record_lines(read, row)
        understood += lines
        warnings += found
    return CheckReport(Path(folder), tuple(understood), tuple(faults), tuple(warnings))


def check_study(study: Study) -> tuple[list[str], list[str]]:
    """Faults and warnings of what a study asks for, given its folder's records.

    Candidates, experiment names, noise model and preparation steps must exist,
    the points to calibrate on must outnumber the parameters, and records should
    outlast the longest time constant of the prior.
    """
    read, faults = scan_folder(study.specimen, study.data_root)
    faults += _unknown_names(study)
    if read is None or faults:
        return faults, []
    from deabayes.systems import build

    rows = _used_rows(study, read, faults)
    if study.calibrate is not None or study.validate is not None:
        every = ((row, read.record(row)) for row in rows)
        faults += repeated_records(every, f"study {study.name}")
    records = [(row, read.record(row)) for row in rows if row.role == "calibrate"]
    warnings: list[str] = []
    for candidate in study.candidates:
        try:
            system = build(read.specimen.system, candidate, read.specimen)
        except UserError as error:
            faults.append(f"study {study.name}, candidates: {error}")
            continue
        where = f"study {study.name}, {candidate}"
        points = sum(raw.columns[row.response].size for row, raw in records)
        faults += too_few_points(points, len(system.parameters()), where) if records else []
        warnings += _too_short_for(system, records, where)
    return faults, warnings


def _unknown_names(study: Study) -> list[str]:
    from deabayes.noise import REGISTRY as NOISE
    from deabayes.preparation import REGISTRY as STEPS

    faults = []
    if study.noise not in NOISE:
        faults.append(f"study {study.name}, noise: unknown {study.noise!r}"
                      f"{nearest(study.noise, NOISE)}")  # fmt: skip
    for protocol, steps in study.preparation.items():
        for step in steps or ():
            name = step if isinstance(step, str) else next(iter(step))
            if name not in STEPS:
                faults.append(f"study {study.name}, preparation.{protocol}: unknown step {name!r}"
                              f"{nearest(name, STEPS)}")  # fmt: skip
    return faults


def _used_rows(study: Study, read: StudyFolder, faults: list[str]) -> list[ExperimentRow]:
    """The rows a study uses, in the roles it gives them."""
    kept = [
        row
        for row in read.table
        if all(str(row.metadata.get(key)) == value for key, value in study.select.items())
    ]
    known = [row.name for row in kept]
    used: list[ExperimentRow] = []
    listed: tuple[tuple[Role, tuple[str, ...] | None], ...]
    listed = (("calibrate", study.calibrate), ("validate", study.validate))
    for role, names in listed:
        unknown = [name for name in names or () if name not in known]
        faults += [
            f"study {study.name}, {role}: {study.specimen} has no experiment {name!r}"
            f"{nearest(name, known)}"
            for name in unknown
        ]
        chosen = [row for row in kept if (row.role == role if names is None else row.name in names)]
        taken = {row.name for row in used}
        used += [replace(row, role=role) for row in chosen if row.name not in taken]
        if role == "calibrate" and not chosen and not unknown:
            faults.append(
                f"study {study.name}: no record to calibrate on in {study.specimen}; give one "
                "the role `calibrate` in experiments.csv"
            )
    return used


def _too_short_for(
    system: System, records: Sequence[tuple[ExperimentRow, RawRecord]], where: str
) -> list[str]:
    """Warn when no calibrated record outlasts the longest time constant the prior expects."""
    constants = [p for p in system.parameters() if p.unit == "s" and p.ordered]
    durations = [float(np.ptp(raw.columns["time"])) for _, raw in records if "time" in raw.columns]
    if not constants or not durations:
        return []
    # The prior's upper quartile: half of its mass lies within a factor or so of it.
    longest = max(float(p.prior.from_normal(np.array(0.6745))) for p in constants)
    return shorter_than_time_constant(max(durations), longest, f"{where}: the longest record")


def _specimen_lines(read: StudyFolder) -> list[str]:
    specimen = read.specimen
    kind = specimen.provenance.get("kind", "unknown provenance")
    lines = [f"{specimen.name}: {specimen.system or 'unknown system'}, {kind}"]
    lines += [f"  {name} = {_shown(q)}" for name, q in specimen.quantities.items()]
    lines += [f"  instrument {name} = {_shown(q)}" for name, q in specimen.instruments.items()]
    return lines


def _shown(quantity: Quantity) -> str:
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    if quantity.sd is None:
        return f"{quantity.value:.6g}{unit} (exact)"
    return f"{quantity.value:.6g} ± {quantity.sd:.2g}{unit} (a parameter)"


def _record_lines(read: StudyFolder, row: ExperimentRow) -> tuple[list[str], list[str]]:
    """What was understood of one record, and its warnings; nothing where it has faults."""
    title = f"{row.name}: {row.protocol}, {row.role}, {row.excitation} -> {row.response}"
    try:
        raw, warnings = read.record(row), read.warnings(row)
    except (Faults, UserError):
        return ["", f"{title} (cannot be used, see the faults)"], []
    extra = ", ".join(f"{key} {value}" for key, value in row.metadata.items())
    lines = ["", title, f"  {read.locate(row)}", f"  {_sampling(raw)}"]
    lines += [f"  {name} from {values.min():.6g} to {values.max():.6g} {raw.units[name]}"
              for name, values in raw.columns.items()]  # fmt: skip
    return lines + ([f"  {extra}"] if extra else []), warnings


def _sampling(raw: RawRecord) -> str:
    rows = next(iter(raw.columns.values())).size
    if "time" not in raw.columns:
        return f"{rows} rows"
    time = raw.columns["time"]
    rate = 1.0 / float(np.median(np.diff(time)))
    return f"{rows} rows, {time[-1] - time[0]:.6g} s, sampled at {rate:.4g} Hz"
