"""Records that a study is to calibrate on and that its prior knows, before anything is run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from deabayes.checks.study import used_rows
from deabayes.faults import UserError
from deabayes.posteriors.counted_records import CountedRecord, counted_records, counted_twice
from deabayes.posteriors.storage import read_tree
from deabayes.reading.folder import read_folder
from deabayes.reading.records import sha256_of
from deabayes.study import Study

SourceOf = Callable[[str], tuple[Study, ...] | Path]
"""What a `prior_from` names: studies of the config (those of a population), else a file."""


def repeated_in_prior(study: Study, source_of: SourceOf) -> list[str]:
    """A sentence on each record that would count twice."""
    if study.prior_from is None:
        return []
    known = list(_known(study.prior_from, source_of, set()))
    return counted_twice(study.name, _calibrated(study), known, study.prior_from)


def _known(source: str, source_of: SourceOf, passed: set[str]) -> Iterator[CountedRecord]:
    """The records behind a posterior, the file there or still to come; circles are passed once."""
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
    """By their files; what is wrong with a folder, or not there, is said elsewhere."""
    try:
        folder = read_folder(study.specimen, study.data_root, check_records=False)
    except UserError:
        return []
    rows = [row for row in used_rows(study, folder, []) if row.role == "calibrate"]
    files = [(row, folder.locate(row)) for row in rows]
    return [
        CountedRecord(study.name, row.name, row.response, sha256_of(path))
        for row, path in files
        if path is not None
    ]
