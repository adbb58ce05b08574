"""The response: steps that change its zero, scale or delay, and what a record shows of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.quantities import with_unit
from deabayes.records.channels import STEPS, least_swing, white_noise, without_single_samples
from deabayes.records.preparation.working import Settings, WorkingRecord
from deabayes.systems import system_class
from deabayes.systems.specimen_quantities import OF_AMPLIFIER, instrument

AT_REST = 0.01
"""Largest first value of the excitation, as a share of its largest value, that counts as rest."""
EARLY = 0.05
"""Share of the excitation's largest value up to which samples are used to extrapolate to rest."""
CONFIRMED = 0.5
"""The first sample must reach this share of an extrapolated reading at rest."""
FEWEST = 3
MEDIAN = 1.2533
"""Standard error of a median divided by the standard error of a mean."""
LEAST, ERRORS = 1e-4, 5.0
"""Limits above which a reading at rest is an offset: share of the response's range, and number
of standard errors."""
DRIFT, OVER_SCATTER, FEWEST_OF_DRIFT = 0.005, 6.0, 8
"""Limits above which a drift at rest matters: share of the response's range, and multiple of the
scatter about the fitted line (a period of hum stays below it). Last, the fewest samples."""
BEGUN, COMPLETE = 0.1, 0.9
"""Shares of an excitation's range at which it has begun, and at which it is complete."""
MOVED, JUMPED = 0.02, 0.2
"""Shares of a response's range: above the first it has begun, above the second it jumps. With a
mass or a circuit, a response cannot rest at first and then be so fast."""
AT_ONCE = 0.5
"""Share of a response's range for its first step after a single sample at rest; a smaller step
may be chance."""
FEWEST_APART = 2
STANDARD_DEVIATIONS = 6.0


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


@dataclass(frozen=True)
class Rest:
    """The reading at rest and its standard error.

    `seen` tells whether the record shows the rest; otherwise the reading is extrapolated.
    """

    record: WorkingRecord
    value: float
    error: float
    seen: bool

    @cached_property
    def is_offset(self) -> bool:
        """Whether the reading differs significantly from zero."""
        least = LEAST * float(np.ptp(self.record.response))
        return abs(self.value) > max(ERRORS * self.error, least)

    def sentence(self, corrected: bool) -> str:
        """Sentence on an offset: that it was subtracted, or how to remove it."""
        record = self.record
        name, protocol = record.row.response, record.row.protocol
        size = with_unit(self.value, record.response_unit, name, digits=3)
        errors = f"{abs(self.value) / self.error:.0f} standard errors" if self.error else "no noise"
        offset = f"the {name} is {size} at rest, where the model has 0 ({errors})"
        if corrected:
            return f"{offset}; it was subtracted (`baseline`)"
        if self.seen:
            return f"{offset}; add `baseline: {{}}` to `preparation: {protocol}`"
        return (
            f"{offset}; rows from before the excitation let `baseline` subtract it, and "
            "`noise: ornstein_uhlenbeck_offset` in the study estimates it"
        )


def reading_at_rest(record: WorkingRecord) -> Rest | None:
    """Reading before the excitation starts, or extrapolated to zero excitation; else None.

    Also None if the response is not zero at rest, or if the record does not begin at rest.
    """
    known = record.row.response in system_class(record.specimen.system).zero_at_rest
    if not (known and _begins_at_rest(record)):
        return None
    gone = _departure(record)
    before = record.used & (record.coordinate < record.excitation_start())
    noise = white_noise(record.response[record.used])
    if before.sum() >= FEWEST:
        value = float(np.median(record.response[before]))  # the median ignores single outliers
        return Rest(record, value, MEDIAN * noise / float(np.sqrt(before.sum())), True)
    early = np.interp(record.coordinate, record.excitation_coordinate, gone) <= EARLY * gone.max()
    first = record.used & np.logical_and.accumulate(early)
    if first.sum() < FEWEST + 1:
        return None
    basis = np.column_stack([np.ones(first.sum()), record.coordinate[first]])
    basis[:, 1] -= basis[0, 1]
    inverse = np.linalg.inv(basis.T @ basis)
    value = float((inverse @ basis.T @ record.response[first])[0])
    if abs(record.response[first][0]) < CONFIRMED * abs(value):
        return None  # the reading is about zero at first, then rises fast
    return Rest(record, value, noise * float(np.sqrt(inverse[0, 0])), False)


def warn_of_drift(record: WorkingRecord) -> None:
    """Warn of a response that drifts before the excitation starts."""
    name = record.row.response
    if record.row.protocol not in STEPS or not _begins_at_rest(record):
        return
    before = record.used & (record.coordinate < record.excitation_start())
    if before.sum() < FEWEST_OF_DRIFT:
        return
    time, response = record.coordinate[before], record.response[before]
    response = without_single_samples(response, least_swing(response))
    length, size = float(np.ptp(time)), float(np.ptp(record.response[record.used]))
    line = np.polyfit(time - time[0], response, 1)
    scatter = float(np.std(response - np.polyval(line, time - time[0])))
    moved = float(line[0]) * length
    if abs(moved) > max(OVER_SCATTER * scatter, DRIFT * size):
        record.report.warn(
            f"the {name} drifts by {with_unit(moved, record.response_unit, name, digits=2)} "
            f"({100 * abs(moved) / size:.2g} % of its range) in the "
            f"{with_unit(length, 's', digits=2)} before the {record.row.excitation} changes, and "
            "the model begins at rest: slow units would fit the drift as creep; let the specimen "
            "settle longer before the record"
        )


def _departure(record: WorkingRecord) -> FloatArray:
    """Distance of the excitation from its value at rest."""
    return np.abs(record.excitation - (1.0 if record.row.excitation == "stretch" else 0.0))


def _begins_at_rest(record: WorkingRecord) -> bool:
    gone = _departure(record)
    return bool(record.in_time and gone[0] <= AT_REST * gone.max())


def warn_if_apart(record: WorkingRecord) -> None:
    """Warn of a response that begins before or after a step of its excitation."""
    row = record.row
    if row.protocol not in STEPS or not record.in_time:
        return
    if instrument(record.specimen, "delay", row.response, "s") is not None:
        return
    time, response = record.coordinate, record.response
    driven = np.abs(record.excitation - record.excitation[0])
    size, noise = float(np.ptp(response)), white_noise(response)
    first = int(np.argmax(driven > BEGUN * driven.max()))
    if first == 0:
        return
    before = response[: max(first - FEWEST_APART, 1)]
    moved = np.abs(response - np.median(before))
    begun = int(np.argmax(moved > max(MOVED * size, STANDARD_DEVIATIONS * noise)))
    apart = with_unit(float(abs(time[begun] - time[first])), "s", digits=3)
    if first - begun >= FEWEST_APART and moved[begun:first].min() > JUMPED * size:
        record.report.warn(
            f"the {row.response} begins {apart} before the {row.excitation}, which is impossible: "
            "their clocks differ, or it is another channel; correct the time of one of them"
        )
    elif _jumps(moved / size, driven / driven.max(), first, begun):
        record.report.warn(
            f"the {row.response} begins {apart} after the {row.excitation}, and then jumps: if its "
            "sensor lags, state `instruments: delay: {value: ..., unit: ms}` in specimen.yaml (up "
            f"to {apart}); the usual steps take a stated delay out"
        )


def _jumps(moved: FloatArray, driven: FloatArray, first: int, begun: int) -> bool:
    """Whether a response rests for some samples, or for one after the full step, and then jumps."""
    if begun + 1 >= moved.size or begun <= first:
        return False
    if begun - first >= FEWEST_APART:
        return bool(moved[begun + 1] > JUMPED)
    return bool(driven[first] > COMPLETE and moved[begun] > AT_ONCE)
