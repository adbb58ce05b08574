"""Rows that a logger left incomplete: cells without a value, time stamps given twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deabayes.reading.raw import RawRecord

REMEDY = "or have such rows left out: record_format: {incomplete_rows: drop} in specimen.yaml"


def without_incomplete(raw: RawRecord, needed: Sequence[str]) -> RawRecord:
    """The record without rows that lack a value in a needed column, or repeat the time before.

    Of rows with one time stamp the first complete one stays. How many rows are gone is kept in
    `left_out`; a record without a needed column, or without any value in one, is returned as it is.
    """
    if not set(needed) <= set(raw.columns):
        return raw
    known = np.array([np.isfinite(raw.columns[name]) for name in needed])
    if not known.any(axis=1).all():
        return raw
    kept = np.asarray(known.all(axis=0))
    if "time" in needed:
        places = np.flatnonzero(kept)
        again = np.diff(raw.columns["time"][places]) == 0.0
        kept[places[1:][again]] = False
    if kept.all():
        return raw
    columns = {name: values[kept] for name, values in raw.columns.items()}
    return replace(raw, columns=columns, left_out=int(kept.size - kept.sum()))
