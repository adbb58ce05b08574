"""What the workflow's jobs are made of: an edit runs a job again only if it changes this."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

from deabayes.faults import UserError
from deabayes.pipeline.prepare import select_rows
from deabayes.records.columns import ExperimentRow
from deabayes.records.folder import StudyFolder, read_folder
from deabayes.records.table import measured_rows
from deabayes.study import Study, fit_settings, settings_on_file

ANY_CANDIDATE = ["any"]
"""A record is prepared alike for all candidates, but a study's settings must name one."""
OF_A_RECORD = ("name", "specimen", "model", "data_root")


def study_folder(study: Study) -> StudyFolder:
    """Read the tables of a study's folder, but no record."""
    return read_folder(study.specimen, study.data_root, check_records=False)


def prepared_rows(study: Study, folder: StudyFolder) -> dict[str, ExperimentRow]:
    """Name of each prepared record of a study -> its row of experiments.csv.

    Only frequency responses are read, because one with a phase gives two prepared records.
    """
    found: dict[str, ExperimentRow] = {}
    for row in select_rows(study, folder.table):
        found[row.name] = row
        if row.protocol == "frequency_response":
            with suppress(UserError):  # the job that prepares the record reports it
                found |= {each.name: row for each in measured_rows(row, folder.read(row))}
    return found


def record_settings(study: Study, row: ExperimentRow) -> dict[str, Any]:
    """The settings that a prepared record depends on, as those of a study of this record alone."""
    settings = settings_on_file(study)
    steps = settings["preparation"].get(row.protocol)
    kept = {key: settings[key] for key in OF_A_RECORD if settings[key] is not None}
    preparation = {} if steps is None else {row.protocol: steps}
    return kept | {
        "candidates": ANY_CANDIDATE,
        row.role: [row.name],
        "preparation": preparation,
    }


def candidate_settings(
    study: Study, candidate: str, folder: StudyFolder, rows: Mapping[str, ExperimentRow]
) -> dict[str, Any]:
    """The settings that the fit of one candidate depends on, without those of other candidates.

    Parameters
    ----------
    rows : of the study's records, from `prepared_rows`.
    """
    study = replace(study, priors=_priors_of(study, candidate, folder))
    fitted = [row for row in rows.values() if row.role == "calibrate"]
    settings = fit_settings(study)
    protocols = {row.protocol for row in fitted}
    steps = {key: value for key, value in settings["preparation"].items() if key in protocols}
    calibrate = list(dict.fromkeys(row.name for row in fitted))
    return settings | {"candidates": [candidate], "calibrate": calibrate, "preparation": steps}


def _priors_of(study: Study, candidate: str, folder: StudyFolder) -> Mapping[str, Any]:
    """The study's priors without those of parameters that only other candidates have.

    An entry that names nothing is kept, so that the fit refuses it.
    """
    from deabayes.inference.default_priors import names_of_all

    if not study.priors or not study.candidates[1:]:
        return study.priors
    with suppress(UserError):  # the check reports a candidate that cannot be built
        every = names_of_all(study, folder.specimen)
        own = names_of_all(replace(study, candidates=(candidate,)), folder.specimen)
        return {k: v for k, v in study.priors.items() if k in own or k not in every}
    return study.priors


def record_content(folder: StudyFolder, row: ExperimentRow) -> str:
    """What a prepared record is made of besides the study's settings, as JSON."""
    file = folder.locate(row)
    content = {
        "row": asdict(row),
        "record_format": folder.file.record_format,
        "specimen": specimen_content(folder),
        "file": None if file is None else checksum(file),
    }
    return json.dumps(content, sort_keys=True, default=str)


def specimen_content(folder: StudyFolder) -> str:
    """The specimen as JSON, in SI units and without the comments of its file."""
    return json.dumps(asdict(folder.specimen), sort_keys=True, default=str)


def folder_content(folder: StudyFolder) -> str:
    """Checksums of the tables and of all records of a study folder, as JSON."""
    records = [folder.locate(row) for row in folder.table]
    files = [folder.path / "specimen.yaml", folder.path / "experiments.csv", *filter(None, records)]
    return json.dumps({file.as_posix(): checksum(file) for file in files})


@cache
def checksum(file: Path) -> str:
    """SHA-256 of a file; it is read once in a process."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
