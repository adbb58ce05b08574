"""Whose noise a predicted record is taken to have."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.faults import UserError
from deabayes.inference.record_noise import ResidualScale, is_ratio
from deabayes.systems.base import Draws, System
from deabayes.systems.specimen_quantities import instrument

SHARE = 0.2
"""Of an excitation's range: noise of a monitor must not count as change."""
SINE = 2.0 * math.asin(SHARE)
"""Phase [rad] in which a sine changes by that share of its range, where it is steepest."""
BISECTIONS = 12
INSTANT = 1e-9
LATE = 1.1
"""What takes this many times as long is still as fast."""


def fastest(experiment: Experiment) -> float:
    r"""Highest frequency that a record's response can tell of [Hz]; NaN without a time axis.

    An excitation that needs the time t for a fifth of its range, where it is steepest, is as
    fast as a sine of 2 arcsin(1/5) / (2 pi t): exact for sines, 0.32 / T for a ramp that lasts
    T. A step has no such end; there it is what was read soonest after it, at the time t, that
    decides, and creep at t is what a sine with omega = 1 / t shows. Changes that nothing was
    read soon after, such as a step before a cropped sine, leave the word to slower ones.
    """
    if experiment.coordinate_name != "time":
        return float("nan")
    span = float(np.ptp(experiment.excitation.coordinate))
    excitation = _rapidity_from_rest(experiment.excitation, span)
    if span == 0.0 or np.ptp(excitation.values) == 0.0:
        return 0.0
    time, omega = _shortest_change(excitation), 0.0
    while omega < SINE / time and time < span:
        soonest = _soonest(excitation, experiment.coordinate, time)
        omega = max(omega, min(SINE / time, 1.0 / soonest))
        time *= LATE
    return omega / (2.0 * math.pi)


def _rapidity_from_rest(excitation: Excitation, span: float) -> Excitation:
    """A voltage is zero before its first knot: a first value other than that is a step."""
    if excitation.unit != "V":
        return excitation
    knots, first = excitation.coordinate, excitation.coordinate[0]
    risen = first + INSTANT * span
    return replace(
        excitation,
        coordinate=np.concatenate([[first, risen], knots[1:]]),
        values=np.append(0.0, excitation.values),
    )


def _shortest_change(excitation: Excitation) -> float:
    """The shortest time in which it changes by `SHARE` of its range [s]."""
    spacing = np.diff(excitation.coordinate)
    wanted = SHARE * float(np.ptp(excitation.values))
    longer = SHARE * float(spacing[spacing > 0.0].min())
    while _changes(excitation, longer).max() < wanted:
        longer *= 2.0
    shorter = 0.5 * longer
    for _ in range(BISECTIONS):
        middle = 0.5 * (shorter + longer)
        if _changes(excitation, middle).max() >= wanted:
            longer = middle
        else:
            shorter = middle
    return longer


def _changes(excitation: Excitation, time: float) -> FloatArray:
    """Changes within `time` that begin at a knot, and those that end at one, (2, K)."""
    knots, values = excitation.coordinate, excitation.values
    after, before = excitation.at(knots + time) - values, values - excitation.at(knots - time)
    return np.abs(np.stack([after, before]))


def _soonest(excitation: Excitation, read: FloatArray, time: float) -> float:
    """From the beginning of a change within about `time` to a reading after it, at least [s]."""
    time *= LATE
    begins, ends = _changes(excitation, time) >= SHARE * float(np.ptp(excitation.values))
    knots = excitation.coordinate
    starts = np.concatenate([knots[begins], knots[ends] - time])
    following = np.searchsorted(read, starts + time)
    followed = following < read.size
    if not followed.any():
        return math.inf
    return float(np.min(read[following[followed]] - starts[followed]))


STILL = 1e-9
"""Of its size: a response that varies by less does not vary."""


@dataclass(frozen=True)
class CalibratedRecord:
    """What a posterior file remembers of a record it was calibrated on."""

    name: str
    protocol: str
    group: str
    scale: float
    response_name: str
    coordinate_name: str
    span: float
    excitation_name: str
    lowest: float
    highest: float
    response_range: float = float("nan")
    """NaN in files written before it was kept."""
    fastest: float = float("nan")
    """Likewise; the highest frequency it tells of [Hz] (see `rapidity.fastest`)."""
    proportional: bool = False
    """Whether its residuals, and so its noise, are of the logarithm (see `ResidualScale`)."""
    elapsed: float = float("nan")
    """From the onset of the excitation to its last reading [s]; NaN also in older files."""
    conditions: Mapping[str, float | str] | None = None
    """What was held; None in files written before it was kept."""

    @classmethod
    def of(cls, experiment: Experiment, group: str, scale: ResidualScale) -> CalibratedRecord:
        values = experiment.excitation.values
        return cls(
            experiment.name,
            experiment.protocol,
            group,
            float(scale.scale),
            experiment.response_name,
            experiment.coordinate_name,
            float(np.ptp(experiment.coordinate)),
            experiment.excitation.name,
            float(values.min()),
            float(values.max()),
            experiment.response_range,
            fastest(experiment),
            scale.proportional,
            experiment.elapsed,
            dict(experiment.excitation.conditions),
        )


def records_to_json(records: list[CalibratedRecord]) -> str:
    """The calibrated records as a JSON list, kept in a posterior file's attributes."""
    return json.dumps([asdict(record) for record in records])


@dataclass(frozen=True)
class NoiseOrigin:
    """Whose noise a record is taken to have, and what its residuals are divided by.

    Attributes
    ----------
    group : of calibrated records, whose noise parameters are taken.
    scale : what the noise is relative to; None takes each draw's own predicted range over
        `calibrated_range`, since a new record's range is not known beforehand.
    smallest : range of the calibrated record that varied least; below it noise does not shrink
        with the range any more. Zero where none measured this response's unit.
    calibrated_range : range of the group's records, where noise in their response's unit is
        carried over to another response.
    proportional : whether residuals are logarithms of ratios (see `ResidualScale`).
    white : standard deviation of the white noise of one raw sample, in the response's unit,
        where the sensor's own noise takes the place of the group's.
    stretch : what the record's coordinate is multiplied by before the group's correlation
        length applies to it, where the group's records have another coordinate.
    note : what a reader must know; empty where nothing was carried over.
    """

    group: str
    scale: float | None = 1.0
    smallest: float = 0.0
    calibrated_range: float = 1.0
    proportional: bool = False
    stretch: float = 1.0
    white: float | None = None
    note: str = ""

    def scales(self, mean: FloatArray) -> FloatArray:
        """What each draw's residuals (W, N) are divided by, (W,); NaN where nothing tells."""
        if self.scale is not None:
            return np.full(mean.shape[0], self.scale)
        ranges = np.maximum(np.ptp(mean, axis=1), self.smallest)
        varies = ranges > STILL * np.max(np.abs(mean), axis=1)
        return np.where(varies, ranges, np.nan) / self.calibrated_range

    def note_on(self, mean: FloatArray, unit: str) -> str:
        """`note`, and what became of the scale for curves (W, N) with too small a range."""
        if self.scale is None and np.median(np.ptp(mean, axis=1)) < self.smallest:
            size = f"{self.smallest:.3g}" + ("" if unit == "1" else f" {unit}")
            return (
                f"the response varies by less than in any calibrated record of {self.group}, so "
                f"its noise is in proportion to the smallest range of those ({size})"
            )
        if np.isnan(self.scales(mean)).any():
            return f"{self.note}; the response does not vary, so its size is not known"
        return self.note

    def draws(self, noise_draws: Draws, scales: FloatArray) -> Draws:
        """The group's noise parameters, the sensor's own white noise in place of theirs."""
        if self.white is None or "sigma_white" not in noise_draws:
            return noise_draws
        return {**noise_draws, "sigma_white": self.white / scales}


def find_noise(
    experiment: Experiment,
    records: Sequence[CalibratedRecord],
    system: System,
    relative: bool,
    along: str,
) -> NoiseOrigin:
    """Whose noise an experiment is taken to have.

    A calibrated record has its own. Another one takes the group of a calibrated
    record of its response's unit, of its protocol if there is one, and of those of one with its
    coordinate; relative noise then scales with each draw's predicted range, but is no smaller than
    that of the calibrated record that varied least. Where none has that unit, noise is carried over
    (see `NoiseOrigin`) from a record of its protocol, else from the first. Where that
    record has another coordinate, the noise's length is in proportion to the records'.

    Parameters
    ----------
    records : the calibrated ones.
    relative : whether noise is in proportion to a record's range (`noise_scale: range`).
    along : along what it is correlated (`noise_coordinate`).

    Raises
    ------
    UserError
        If noise has to be carried over, and the posterior file is too old for it.
    """
    proportional = experiment.response_name in system.proportional
    for record in records:
        if record.name == experiment.name:
            return NoiseOrigin(record.group, record.scale, proportional=proportional)
    alike = [r for r in records if system.responses[r.response_name] == experiment.response_unit]
    matches = alike or records
    like = [r for r in matches if r.protocol == experiment.protocol] or matches[:1]
    first = next((r for r in like if r.coordinate_name == experiment.coordinate_name), like[0])
    stretch = 1.0 if along == "grid" else _stretch(experiment, first)
    if alike:
        if not relative or is_ratio(system, experiment.response_name):
            return NoiseOrigin(first.group, proportional=proportional, stretch=stretch)
        smallest = min(r.scale for r in alike if r.group == first.group)
        return NoiseOrigin(first.group, None, smallest, stretch=stretch)
    group = [r for r in records if r.group == first.group]
    plain = relative or is_ratio(system, first.response_name)
    calibrated = 1.0 if plain else float(np.mean([r.response_range for r in group]))
    return replace(_carried_over(experiment, first, calibrated, system), stretch=stretch)


def _carried_over(
    experiment: Experiment, source: CalibratedRecord, calibrated: float, system: System
) -> NoiseOrigin:
    """The noise of a record that measured something else, over a range `calibrated`."""
    name, unit = experiment.response_name, experiment.response_unit
    if not np.isfinite(calibrated):
        raise UserError(
            f"{system.candidate}: no calibrated record measured {name}, and "
            "this posterior does not keep the ranges that its noise would be carried over "
            "by; fit again"
        )
    note = f"no calibrated record measured {name}: its noise is that of {source.response_name}"
    if is_ratio(system, experiment.response_name):
        proportional = name in system.proportional
        return NoiseOrigin(
            source.group,
            scale=1.0 / calibrated,
            proportional=proportional,
            note=f"{note}, as a fraction of its range" + ("" if proportional else ", in radians"),
        )
    sensor = instrument(system.specimen, "noise", name, unit)
    return NoiseOrigin(
        source.group,
        scale=None,
        calibrated_range=calibrated,
        white=None if sensor is None else sensor.value,
        note=f"{note}, in proportion to the response's range"
        + ("" if sensor is None else "; white noise as specimen.yaml states it"),
    )


def _stretch(experiment: Experiment, source: CalibratedRecord) -> float:
    """From a record's coordinate to another's whose noise it is taken to have."""
    extent = float(np.ptp(experiment.coordinate))
    if source.coordinate_name == experiment.coordinate_name or extent == 0.0:
        return 1.0
    return source.span / extent
