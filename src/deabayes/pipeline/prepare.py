"""From raw records to prepared ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from deabayes.experiment import PHASE, Experiment
from deabayes.faults import UserError, nearest
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.folder import StudyFolder, read_folder
from deabayes.records.preparation.defaults import misaddressed
from deabayes.records.preparation.prepared import read_prepared, to_dataset, write_prepared
from deabayes.records.table import in_roles, measured_rows, none_to_fit, selected
from deabayes.study import Study


def prepare_study(study: Study, output: Path) -> list[Experiment]:
    """Read, check and prepare every record of a study into `output/{experiment}.nc`.

    A frequency response gives two files: its gain and its phase. Nothing is written before all
    records are prepared. Files of records that the study no longer has are removed.
    """
    from deabayes.posteriors.storage import write_datasets

    folder = read_folder(study.specimen, study.data_root)
    rows = select_rows(study, folder.table)
    if wrong := misaddressed(study.preparation, folder.table):
        raise UserError("\n".join(f"study {study.name}, {fault}" for fault in wrong))
    prepared = [pair for row in rows for pair in _prepared(study, folder, row)]
    datasets = {experiment.name: to_dataset(experiment, raw) for experiment, raw in prepared}
    write_datasets(datasets, output, mark="record_sha256")
    return [experiment for experiment, _ in prepared]


def prepare_record(study: Study, name: str, output: Path) -> None:
    """Read, check and prepare one record of a study into `output/{name}.nc`.

    Other records of the study are not read. `NAME_phase` is the phase of a frequency response.
    """
    folder = read_folder(study.specimen, study.data_root, check_records=False)
    rows = in_roles(selected(folder.table, study.select), study.calibrate, study.validate)
    for row in rows:
        if name in (row.name, f"{row.name}{PHASE}"):
            for experiment, raw in _prepared(study, folder, row):
                if experiment.name == name:
                    return write_prepared(experiment, output / f"{name}.nc", raw)
    known = [row.name for row in rows]
    raise UserError(f"study {study.name} has no record {name!r}{nearest(name, known)}")


def _prepared(
    study: Study, folder: StudyFolder, row: ExperimentRow
) -> Iterator[tuple[Experiment, RawRecord]]:
    """Yield each measurement of a row, prepared, with its raw record.

    Warnings about the record are added unless the preparation gives the same.
    """
    from deabayes.records.preparation import prepare

    raw, steps = folder.record(row), study.preparation.get(row.protocol)
    for measured in measured_rows(row, raw):
        experiment = prepare(measured, raw, folder.specimen, steps)
        said = {warning.partition(": ")[2] for warning in experiment.warnings}
        more = [w for w in folder.warnings(row) if w.partition(": ")[2] not in said]
        yield replace(experiment, warnings=(*experiment.warnings, *more)), raw


def select_rows(study: Study, rows: Sequence[ExperimentRow]) -> list[ExperimentRow]:
    """Rows of experiments.csv that a study uses, with the roles the study gives them.

    `calibrate` and `validate` of the study replace the column `role`; `validate: []` holds out no
    record. `select` keeps the rows whose column has the wanted value.
    """
    kept = selected(rows, study.select)
    known = [row.name for row in kept]
    for key, names in (("calibrate", study.calibrate), ("validate", study.validate)):
        for name in names or ():
            if name not in known:
                raise UserError(
                    f"study {study.name}, {key}: {name!r} is no experiment of "
                    f"{study.specimen}{nearest(name, known)}"
                )
    used = in_roles(kept, study.calibrate, study.validate)
    if not any(row.role == "calibrate" for row in used):
        said = none_to_fit(study.specimen, study.calibrate, study.validate)
        raise UserError(f"study {study.name}: {said}")
    return used


def read_experiments(prepared: Path) -> list[Experiment]:
    """Read all prepared records of a study, sorted by name."""
    paths = sorted(Path(prepared).glob("*.nc"))
    if not paths:
        raise UserError(f"{prepared}: holds no prepared record; run `deabayes prepare` first")
    return [read_prepared(path) for path in paths]


def calibrated_files(study: Study, prepared: Path) -> list[Path]:
    """Files of the prepared records that are fitted, sorted by name.

    If the study lists its calibration records, no other file is opened: a workflow may write it at
    the same time.

    Raises
    ------
    UserError : a listed record is missing, or was prepared as a held-out record.
    """
    if study.calibrate is None:
        files = sorted(Path(prepared).glob("*.nc"))
        return [path for path in files if read_prepared(path).role == "calibrate"]
    phases = [prepared / f"{name}{PHASE}.nc" for name in study.calibrate]
    files = [prepared / f"{name}.nc" for name in study.calibrate]
    files = sorted([*files, *(path for path in phases if path.is_file())])
    for path in files:
        if (role := read_prepared(path).role) != "calibrate":
            raise UserError(
                f"{path}: was prepared with the role {role}, but study {study.name} calibrates on "
                "it; run `deabayes prepare` again"
            )
    return files
