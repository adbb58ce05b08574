"""The line from raw records to a report, one function per stage.

The command line and the workflow's rules call these; each reads files, calls
the layers below and writes files, nothing else.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deabayes.experiment import Experiment
from deabayes.faults import UserError, nearest
from deabayes.study import Study


def seed_of(study: Study, candidate: str, stage: str, index: int = 0) -> np.random.SeedSequence:
    """One explicit stream per (seed, study, candidate, stage, index)."""
    words = [zlib.crc32(text.encode()) for text in (study.name, candidate, stage)]
    return np.random.SeedSequence([study.sampling.seed, *words, index])


def prepare_study(study: Study, output: Path) -> list[Experiment]:
    """Read, check and prepare every record of a study into `output/{experiment}.nc`."""
    from deabayes.preparation import prepare
    from deabayes.preparation.prepared import write_prepared
    from deabayes.reading.folder import read_folder

    folder = read_folder(study.specimen, study.data_root)
    rows = select_rows(study, folder.table)
    output.mkdir(parents=True, exist_ok=True)
    experiments = []
    for row in rows:
        raw = folder.record(row)
        experiment = prepare(row, raw, folder.specimen, study.preparation.get(row.protocol))
        write_prepared(experiment, output / f"{experiment.name}.nc", raw)
        experiments.append(experiment)
    return experiments


def read_experiments(prepared: Path) -> list[Experiment]:
    """All prepared records of a study, by name."""
    from deabayes.preparation.prepared import read_prepared

    paths = sorted(Path(prepared).glob("*.nc"))
    if not paths:
        raise UserError(f"{prepared}: holds no prepared record; run `deabayes prepare` first")
    return [read_prepared(path) for path in paths]
