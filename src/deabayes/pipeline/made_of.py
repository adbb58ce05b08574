"""What a fit is made of, as a sum: where it is as it was, nothing need be sampled again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from deabayes.pipeline.prepare import select_rows
from deabayes.study import Study, fit_settings


def fit_made_of(study: Study) -> str:
    """SHA-256 of settings, specimen, and the rows and files of the calibrated records.

    Other candidates and held-out records have no part in it. A posterior that `prior_from`
    names, a model file and the code are files of their own.

    Raises
    ------
    Faults, UserError : specimen.yaml, experiments.csv or the names in the study are at fault.
    """
    from deabayes.posteriors.storage import specimen_to_json
    from deabayes.reading.folder import read_folder

    folder = read_folder(study.specimen, study.data_root, check_records=False)
    rows = [row for row in select_rows(study, folder.table) if row.role == "calibrate"]
    files = [folder.locate(row) or folder.path / row.record for row in rows]
    content = {
        "settings": fit_settings(study),
        "specimen": json.loads(specimen_to_json(folder.specimen)),
        "record_format": folder.file.record_format,
        "rows": [asdict(row) for row in rows],
        "records": sums(files),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def sums(files: Iterable[Path]) -> dict[str, str]:
    """SHA-256 by path; a file that is not there has none."""
    return {
        path.as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.is_file()
    }
