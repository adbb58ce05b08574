"""Preparation steps that change the response: its zero, its scale, its delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.faults import UserError
from deabayes.records.preparation.working import Settings, WorkingRecord
from deabayes.systems.specimen_quantities import OF_AMPLIFIER, instrument


def baseline(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Subtract the mean of the response before the excitation starts.

    Settings
    --------
    until : end of the averaged stretch; default the start of the excitation.
    response : the only response to correct, if records of one protocol have several. At rest
        a displacement is zero, but an area or a stretch is not.
    """
    read = Settings("baseline", settings, record, ("until", "response"))
    if read.of_another():
        return record
    until = read.quantity("until", record.coordinate_unit, record.excitation_start())
    rest = record.used & (record.coordinate <= until)
    if rest.sum() < 2:
        raise UserError(
            f"{read.where}: {int(rest.sum())} samples up to {until:g} {record.coordinate_unit}, "
            "where the excitation starts; give `until`, or leave the step out"
        )
    return replace(record, response=record.response - record.response[rest].mean())


def scale(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Multiply the response by a number; the raw file does not change.

    Settings
    --------
    by : the number; -1 changes the sign.
    response : the only response to scale, if records of one protocol have several.
    record : the only experiment to scale; default all of the protocol.
    """
    read = Settings("scale", settings, record, ("by", "response", "record"))
    if read.of_another():
        return record
    factor = read.quantity("by", "1")
    if factor == 0.0:
        raise UserError(f"{read.where}.by: 0 leaves nothing of the response; give -1 or a gain")
    return replace(record, response=factor * record.response)


def delay(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Shift the response to earlier times: a value stamped t belongs to t - delay.

    Values that then lie before the first sample of the excitation are hidden, because the
    excitation that caused them was not recorded. A delay makes the phase of a frequency response
    lag by 2 pi f times the delay; this lag is added back. A gain is not changed.

    Settings
    --------
    time : the delay; default `instruments.delay` of specimen.yaml. For a current, which the
        amplifier measures, the default is `instruments.current.delay` only.
    """
    read = Settings("delay", settings, record, ("time",))
    sensor = instrument(record.specimen, "delay", record.row.response, "s")
    if not read.has("time") and sensor is None:
        raise UserError(f"{read.where}: give `time`, or {_where_stated(record.row.response)}")
    shift = read.quantity("time", "s", None if sensor is None else sensor.value)
    if shift < 0.0:
        raise UserError(
            f"{read.where}.time: must not be negative, found {shift:g} s; a sensor lags, give the "
            "time by which it does"
        )
    if record.coordinate_name == "frequency":
        phase = record.row.response == "phase"
        lag = 2.0 * np.pi * record.coordinate * shift
        return replace(record, response=record.response + lag) if phase else record
    coordinate = record.coordinate - shift
    hidden = coordinate < record.excitation_coordinate[0]
    return replace(record.mask(hidden), coordinate=coordinate, delay=record.delay + shift)


def _where_stated(response: str) -> str:
    """Say where specimen.yaml may state the delay of a response."""
    if response not in OF_AMPLIFIER:
        return "`instruments: delay:` in specimen.yaml"
    return (
        f"`instruments: {response}: delay:` in specimen.yaml, zero if there is none; that of the "
        f"other sensors, `instruments: delay:`, is not the {response}'s, which the amplifier shows"
    )
