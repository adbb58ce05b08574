"""Preparation steps that hide samples from the likelihood, or drop them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.records.channels import white_noise
from deabayes.records.preparation.excitation import turns
from deabayes.records.preparation.working import Settings, WorkingRecord

OVER_NOISE, OVER_STEP = 10.0, 2.0
LARGEST_TURN = 0.25
"""Share of the excitation's range above which a change counts as a turn, whatever the noise."""


def mask_after(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response after `time`.

    Settings
    --------
    time : limit on the record's coordinate (a stretch, if a quasi-static record is in stretch).
    from_step : count `time` from the start of the excitation; default false.
    """
    read = Settings("mask_after", settings, record, ("time", "from_step"))
    return record.mask(record.coordinate > read.coordinate("time"))


def mask_before(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response before `time`.

    Settings
    --------
    time : limit on the record's coordinate (a stretch, if a quasi-static record is in stretch).
    from_step : count `time` from the start of the excitation; default false.
    """
    read = Settings("mask_before", settings, record, ("time", "from_step"))
    return record.mask(record.coordinate < read.coordinate("time"))


def mask_between(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response from `from` to `to`, both included.

    Settings
    --------
    from, to : limits on the record's coordinate (stretches, if a quasi-static record is in
        stretch).
    from_step : count both from the start of the excitation; default false.
    record : the only experiment that is masked; default all of the protocol.
    """
    read = Settings("mask_between", settings, record, ("from", "to", "from_step", "record"))
    if read.of_another():
        return record
    first, last = read.coordinate("from"), read.coordinate("to")
    if not first < last:
        raise UserError(f"{read.where}: `to` ({last:g}) must lie behind `from` ({first:g})")
    return record.mask((record.coordinate >= first) & (record.coordinate <= last))


def mask_ramp_end(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response around the end of every ramp.

    Only the response is hidden: the specimen went through the overshoot, so it stays in the
    excitation. The load cell's own inertia answers the braking with a transient that is no
    material response.

    Settings
    --------
    before, after : widths on both sides of the ramp's end; default 0.1 s and 0.3 s.
    at : the end of the only ramp; if given, ramp ends are not detected.
    """
    read = Settings("mask_ramp_end", settings, record, ("before", "after", "at"))
    ends = [read.quantity("at", record.coordinate_unit)] if read.has("at") else ramp_ends(record)
    before = read.quantity("before", record.coordinate_unit, 0.1)
    after = read.quantity("after", record.coordinate_unit, 0.3)
    past = record.coordinate - np.array(ends)[:, None]
    return record.mask(np.any((past >= -before) & (past <= after), axis=0))


def ramp_ends(record: WorkingRecord) -> list[float]:
    """Return the turns that are reached at more than half the largest speed and left at less.

    Speed is that of the departure from the excitation's first value. The way back of a triangle
    and a slow spring back therefore do not count. Speeds are taken between turns that exceed the
    noise, because noise would have the largest speed from sample to sample.
    """
    time, values = record.excitation_coordinate, record.excitation
    knots = turns(time, values, min(_unseen(values), LARGEST_TURN * record.excitation_range))
    departure = np.abs(values[knots] - values[0])
    speed = np.diff(departure) / np.diff(time[knots])
    fast = np.append(speed > 0.5 * speed.max(), False)
    return [float(end) for end in time[knots[1:][fast[:-1] & ~fast[1:]]]]


def _unseen(values: FloatArray) -> float:
    """Largest size of a turn that noise or a digital sensor's steps could explain."""
    steps = np.abs(np.diff(values))
    return max(
        OVER_NOISE * white_noise(values),
        OVER_STEP * float(np.min(steps[steps > 0.0], initial=np.inf)),
    )


def mask_slack(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response from where it falls to `threshold` after the excitation's peak.

    A relaxed strip is longer than when it was mounted and buckles before the crosshead is back;
    no model of tension describes buckling. Everything between the first and the last sample at
    or below the threshold is hidden, so that noise does not leave single samples.

    Settings
    --------
    threshold : value of the response, e.g. 0.01 N.
    """
    read = Settings("mask_slack", settings, record, ("threshold",))
    threshold = read.quantity("threshold", record.response_unit)
    departure = np.abs(record.excitation - record.excitation[0])
    peak = record.excitation_coordinate[int(np.argmax(departure))]
    slack = np.flatnonzero((record.coordinate > peak) & (record.response <= threshold))
    hidden = np.zeros(record.used.size, dtype=bool)
    if slack.size:
        hidden[slack[0] : slack[-1] + 1] = True
    return record.mask(hidden)


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
