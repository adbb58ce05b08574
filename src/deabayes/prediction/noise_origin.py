"""Which calibrated record's noise a predicted record is assumed to have."""

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
"""Share of an excitation's range that counts as a change, so that monitor noise does not count."""
SINE = 2.0 * math.asin(SHARE)
"""Phase [rad] in which a sine changes by `SHARE` of its range where the sine is steepest."""
BISECTIONS = 12
INSTANT = 1e-9
LATE = 1.1
"""Tolerance factor on times: a change that takes up to 1.1 times as long counts as equally fast."""


def fastest(experiment: Experiment) -> float:
    r"""Highest frequency that a record's response gives information on [Hz]; NaN without time.

    Let t be the shortest time in which the excitation changes by a fifth of its range. The
    excitation is then as fast as a sine with the frequency 2 arcsin(1/5) / (2 pi t). This is
    exact for sines, and 0.32 / T for a ramp that lasts T. For a step, t has no lower limit. The
    first reading after the step limits the frequency instead: creep at the time t after a step
    shows what a sine with omega = 1 / t shows. If nothing was read soon after a change (a step
    before a cropped sine), slower changes determine the frequency.
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
    """Let a voltage rise from zero at its first knot: a nonzero first value is a step."""
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
    """Shortest time in which an excitation changes by `SHARE` of its range [s]."""
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
    """Absolute changes within `time` after each knot and before each knot, (2, K)."""
    knots, values = excitation.coordinate, excitation.values
    after, before = excitation.at(knots + time) - values, values - excitation.at(knots - time)
    return np.abs(np.stack([after, before]))


def _soonest(excitation: Excitation, read: FloatArray, time: float) -> float:
    """Shortest time from the start of a change within about `time` to a reading after it [s]."""
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
"""Share of a response's largest magnitude; a response that varies by less counts as constant."""


@dataclass(frozen=True)
class CalibratedRecord:
    """What a posterior file stores about a record that the candidate was calibrated on."""

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
    """NaN in older files, which do not store it."""
    fastest: float = float("nan")
    """Highest frequency that the record gives information on [Hz] (`fastest`); NaN in old files."""
    proportional: bool = False
    """Whether residuals and noise refer to the response's logarithm (see `ResidualScale`)."""
    elapsed: float = float("nan")
    """Time from the onset of the excitation to the last reading [s]; NaN also in older files."""
    conditions: Mapping[str, float | str] | None = None
    """Conditions held during the record; None in older files, which do not store them."""

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
    """Return the calibrated records as a JSON list for a posterior file's attributes."""
    return json.dumps([asdict(record) for record in records])


@dataclass(frozen=True)
class NoiseOrigin:
    """The noise that a record is assumed to have, and the scale that divides its residuals.

    Attributes
    ----------
    group : group of calibrated records whose noise parameters are used.
    scale : the scale that divides residuals. None means: each draw's predicted range divided by
        `calibrated_range`, since the range of a new record is not known beforehand.
    smallest : smallest range of a calibrated record of the group. A smaller predicted range does
        not make the noise smaller. Zero if no calibrated record has this response's unit.
    calibrated_range : mean range of the group's records, used if absolute noise of their response
        is carried over to another response; else 1.
    proportional : whether residuals are logarithms of ratios (see `ResidualScale`).
    white : standard deviation of the white noise of one raw sample, in the response's unit, if
        the sensor's stated noise replaces that of the group.
    stretch : factor on the record's coordinate before the group's correlation length applies, if
        the group's records have another coordinate.
    note : what a reader must know about the noise; empty if no noise was carried over.
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
        """Scale that divides each draw's residuals, (W,); NaN where the scale is unknown."""
        if self.scale is not None:
            return np.full(mean.shape[0], self.scale)
        ranges = np.maximum(np.ptp(mean, axis=1), self.smallest)
        varies = ranges > STILL * np.max(np.abs(mean), axis=1)
        return np.where(varies, ranges, np.nan) / self.calibrated_range

    def note_on(self, mean: FloatArray, unit: str) -> str:
        """Return `note`, or a note on the scale if the curves (W, N) vary too little."""
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
        """Noise parameters of the group, with the sensor's stated white noise if it is known."""
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
    """Choose the calibrated records whose noise an experiment is assumed to have.

    A calibrated record has its own noise. Another record gets the noise of the group of a
    calibrated record with the same unit of the response. A record of the same protocol is
    preferred, and among those a record with the same coordinate. Relative noise then scales with
    each draw's predicted range, but no less than with the smallest range in the group.

    If no calibrated record has that unit, noise is carried over (see `NoiseOrigin`) from a record
    of the same protocol, else from the first record. If the chosen record has another coordinate,
    the correlation length scales with the ratio of the records' extents.

    Parameters
    ----------
    records : the calibrated records.
    relative : whether noise is proportional to a record's range (`noise_scale: range`).
    along : coordinate along which the noise is correlated (`noise_coordinate`).

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
    """Carry over the noise of a record of another response, whose mean range is `calibrated`."""
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
    """Factor from an experiment's coordinate to the coordinate of the record that gives noise."""
    extent = float(np.ptp(experiment.coordinate))
    if source.coordinate_name == experiment.coordinate_name or extent == 0.0:
        return 1.0
    return source.span / extent
