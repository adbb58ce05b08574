"""Keep single samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def decimate(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Keep every n-th visible sample as it was measured, nothing averaged.

    Settings
    --------
    every : n; or
    points : about how many samples to keep.
    """
    read = Settings("decimate", settings, record, ("every", "points"))
    read.at_most_one("every", "points")
    visible = np.flatnonzero(record.used)
    every = (
        read.count("every")
        if read.has("every")
        else int(np.ceil(visible.size / read.count("points")))
    )
    kept = visible[:: max(every, 1)]
    return replace(
        record,
        coordinate=record.coordinate[kept],
        response=record.response[kept],
        used=np.ones(kept.size, dtype=bool),
        samples_averaged=record.samples_averaged[kept],
        nodes=record.nodes and record.nodes.at(kept),
    )
