"""From raw records to prepared ones, with the roles a study gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from deabayes.experiment import Experiment
from deabayes.faults import UserError, nearest
from deabayes.reading.raw import ExperimentRow
from deabayes.reading.selection import in_roles, none_to_fit, selected
from deabayes.study import Study


def prepare_study(study: Study, output: Path) -> list[Experiment]:
    """Read, check and prepare every record of a study into `output/{experiment}.nc`.

    A frequency response gives two, its gain and its phase. Nothing is written before all are
    prepared; what was there of records that the study no longer has is removed.
    """
    from deabayes.posteriors.storage import write_datasets
    from deabayes.preparation import measured_rows, prepare
    from deabayes.preparation.addressed import misaddressed
    from deabayes.preparation.idle_masks import with_idle_masks
    from deabayes.preparation.prepared import to_dataset
    from deabayes.reading.folder import read_folder

    folder = read_folder(study.specimen, study.data_root)
    rows = select_rows(study, folder.table)
    if wrong := misaddressed(study.preparation, folder.table):
        raise UserError("\n".join(f"study {study.name}, {fault}" for fault in wrong))
    experiments, raws = [], []
    for row in rows:
        raw, steps = folder.record(row), study.preparation.get(row.protocol)
        for each in measured_rows(row, raw):
            experiment = prepare(each, raw, folder.specimen, steps)
            said = {warning.partition(": ")[2] for warning in experiment.warnings}
            unseen = [w for w in folder.warnings(row) if w.partition(": ")[2] not in said]
            experiments.append(replace(experiment, warnings=(*experiment.warnings, *unseen)))
            raws.append(raw)
    experiments = with_idle_masks(experiments)
    datasets = {e.name: to_dataset(e, raw) for e, raw in zip(experiments, raws, strict=True)}
    write_datasets(datasets, output, mark="record_sha256")
    return experiments


def read_experiments(prepared: Path) -> list[Experiment]:
    """All prepared records of a study, by name."""
    from deabayes.preparation.prepared import read_prepared

    paths = sorted(Path(prepared).glob("*.nc"))
    if not paths:
        raise UserError(f"{prepared}: holds no prepared record; run `deabayes prepare` first")
    return [read_prepared(path) for path in paths]


def calibrated_files(prepared: Path) -> list[Path]:
    """The files of the prepared records that are fitted, by name."""
    from deabayes.preparation.prepared import read_prepared

    files = sorted(Path(prepared).glob("*.nc"))
    return [path for path in files if read_prepared(path).role == "calibrate"]


def select_rows(study: Study, rows: Sequence[ExperimentRow]) -> list[ExperimentRow]:
    """The rows a study uses, with the roles the study gives them.

    `calibrate` and `validate` of the study override the role column, `validate: []` with no
    held-out record; `select` keeps the rows whose column has the wanted value.
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
