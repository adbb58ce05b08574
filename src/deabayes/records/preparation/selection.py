"""Preparation steps that keep part of a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.faults import UserError
from deabayes.records.preparation.working import Settings, WorkingRecord


def crop(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Keep the response within [from, to].

    The excitation before `from` stays, because the material remembers it. The excitation after
    `to` is removed, because it has no effect on what is kept.

    Settings
    --------
    from, to : limits on the record's coordinate; default its first and last value.
    from_step : count both from the start of the excitation; default false.
    """
    read = Settings("crop", settings, record, ("from", "to", "from_step"))
    first = read.coordinate("from") if read.has("from") else -np.inf
    last = read.coordinate("to") if read.has("to") else np.inf
    if not first < last:
        raise UserError(f"{read.where}: 'from' ({first:g}) must be smaller than 'to' ({last:g})")
    cropped = record.mask((record.coordinate < first) | (record.coordinate > last))
    if last >= record.excitation_coordinate[-1]:
        return cropped
    knots = record.excitation_coordinate < last
    end = np.interp(last, record.excitation_coordinate, record.excitation)
    return replace(
        cropped,
        excitation_coordinate=np.append(record.excitation_coordinate[knots], last),
        excitation=np.append(record.excitation[knots], end),
    )


def decimate(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Keep every n-th visible sample as measured, without averaging.

    Settings
    --------
    every : n; or
    points : approximate number of samples to keep.
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
