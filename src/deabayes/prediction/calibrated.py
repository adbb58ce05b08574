"""The calibration records as a posterior file stores them, and the region that they span."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.inference.record_noise import ResidualScale
from deabayes.systems.base import System

LONGEST_EXTRAPOLATION = 1.5
FASTEST_EXTRAPOLATION = 1.5
RANGE_TOLERANCE = 0.01
FAR_BELOW = 0.01
"""Share of the calibrated voltage below which a voltage may have been given in kV."""
SHARE = 0.2
"""Share of an excitation's range that counts as a change, so that monitor noise does not count."""
SINE = 2.0 * math.asin(SHARE)
"""Phase [rad] in which a sine changes by `SHARE` of its range where the sine is steepest."""
BISECTIONS = 12
INSTANT = 1e-9
LATE = 1.1
"""Tolerance factor on times: a change that takes up to 1.1 times as long counts as equally fast."""


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
    correlated_scale: float = 1.0
    """Unit of the standard deviation of correlated noise, in the unit of the residuals."""
    conditions: Mapping[str, float | str] | None = None
    """Conditions held during the record; None in older files, which do not store them."""

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        group: str,
        scale: ResidualScale,
        correlated_scale: float = 1.0,
    ) -> CalibratedRecord:
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
            correlated_scale,
            dict(experiment.excitation.conditions),
        )


def records_to_json(records: list[CalibratedRecord]) -> str:
    """Return the calibrated records as a JSON list for a posterior file's attributes."""
    return json.dumps([asdict(record) for record in records])


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
    excitation = _from_rest(experiment.excitation, span)
    if span == 0.0 or np.ptp(excitation.values) == 0.0:
        return 0.0
    time, omega = _shortest_change(excitation), 0.0
    while omega < SINE / time and time < span:
        soonest = _first_reading(excitation, experiment.coordinate, time)
        omega = max(omega, min(SINE / time, 1.0 / soonest))
        time *= LATE
    return omega / (2.0 * math.pi)


def _from_rest(excitation: Excitation, span: float) -> Excitation:
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


def _first_reading(excitation: Excitation, read: FloatArray, time: float) -> float:
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


@dataclass(frozen=True)
class Calibrated:
    """The calibration records of a system.

    Attributes
    ----------
    system : defines the channels whose sign makes no difference, and the conditions on which
        responses depend.
    records : the records as a posterior file stores them. Entries that older files lack are not
        compared.
    """

    system: System
    records: Sequence[CalibratedRecord]

    def extrapolation(self, experiment: Experiment) -> str:
        """Say how a prediction leaves the calibrated region; empty if the prediction is inside."""
        notes = (
            self._range(experiment),
            *self._conditions(experiment),
            self._duration(experiment),
            self._frequency(experiment),
        )
        return "; ".join(note for note in notes if note)

    def unit_note(self, experiment: Experiment) -> str:
        """Say that a voltage is so small that it may be in kV; empty for any other excitation."""
        driven = experiment.excitation
        known = [
            max(abs(r.lowest), abs(r.highest))
            for r in self.records
            if r.excitation_name == driven.name
        ]
        largest = float(np.abs(driven.values).max())
        if driven.unit != "V" or not known or not 0.0 < largest < FAR_BELOW * max(known):
            return ""
        return (
            f"{driven.name} reaches only {largest:.4g} V, and the calibration records "
            f'{max(known):.4g} V; if it is in kV, give its unit ("{largest:.4g} kV")'
        )

    def _range(self, experiment: Experiment) -> str:
        driven = experiment.excitation
        ends = [
            # A record starts without excitation: a voltage is zero before its first knot.
            [r.lowest, r.highest] + [0.0] * (driven.unit == "V" and r.coordinate_name == "time")
            for r in self.records
            if r.excitation_name == driven.name
        ]
        if not ends:
            return f"no calibration record was driven by {driven.name}"
        known = np.concatenate([self._folded(driven.name, np.array(pair)) for pair in ends])
        asked = self._folded(driven.name, driven.values)
        if _within(asked, known):
            return ""
        unit = "" if driven.unit == "1" else f" {driven.unit}"
        return (
            f"{driven.name} {asked.min():.4g} to {asked.max():.4g}{unit} lies outside the "
            f"calibrated {known.min():.4g} to {known.max():.4g}{unit}"
        )

    def _conditions(self, experiment: Experiment) -> list[str]:
        driven = experiment.excitation
        asked = self._relevant(driven.name, driven.conditions)
        calibrated = [
            self._relevant(r.excitation_name, r.conditions)
            for r in self.records
            if r.conditions is not None
        ]
        known = {name: [c[name] for c in calibrated if name in c] for name in asked}
        return [self._condition(name, asked[name], known[name]) for name in asked if known[name]]

    def _condition(self, name: str, asked: float | str, known: Sequence[float | str]) -> str:
        numbers = [value for value in known if not isinstance(value, str)]
        if isinstance(asked, str) or not numbers:
            words = ", ".join(sorted({str(value) for value in known}))
            return "" if asked in known else f"{name} {asked} was not calibrated ({words} was)"
        values = self._folded(name, np.array(numbers, dtype=float))
        value = self._folded(name, np.array([asked], dtype=float))
        if _within(value, values):
            return ""
        channel = self.system.excitations.get(name, "1")
        unit = "" if channel == "1" else f" {channel}"
        ends = dict.fromkeys(f"{end:.5g}" for end in (values.min(), values.max()))
        return f"{name} {value[0]:.5g}{unit} lies outside the calibrated {' to '.join(ends)}{unit}"

    def _relevant(
        self, excitation: str, conditions: Mapping[str, float | str]
    ) -> Mapping[str, float | str]:
        """Return the conditions on which responses depend, as far as they are known."""
        defaults = (self.system.conditions or {}).get(excitation, {})
        stated = {name: conditions.get(name, default) for name, default in defaults.items()}
        return {name: value for name, value in stated.items() if value is not None}

    def _duration(self, experiment: Experiment) -> str:
        if experiment.coordinate_name != "time":
            return ""
        timed = [r for r in self.records if r.coordinate_name == "time"]
        span, since = experiment.elapsed, " from the onset of the excitation"
        longest = max((r.elapsed for r in timed), default=0.0)
        if np.isnan(longest):
            span, since = float(np.ptp(experiment.coordinate)), ""
            longest = max(r.span for r in timed)
        if span <= LONGEST_EXTRAPOLATION * longest:
            return ""
        return (
            f"{span:.4g} s{since} is more than {LONGEST_EXTRAPOLATION} times the longest "
            f"calibration record ({longest:.4g} s)"
        )

    def _frequency(self, experiment: Experiment) -> str:
        reached = fastest(experiment)
        timed = (r.fastest for r in self.records if r.coordinate_name == "time")
        known = max(timed, default=np.nan)
        if not reached > FASTEST_EXTRAPOLATION * known:
            return ""
        shown, calibrated = (f"{float(f'{hertz:.2g}'):g} Hz" for hertz in (reached, known))
        return f"the prediction reaches {shown}, and the calibration records only {calibrated}"

    def _folded(self, channel: str, values: FloatArray) -> FloatArray:
        """Return magnitudes if the sign makes no difference; add zero if both signs occur."""
        if channel not in self.system.even:
            return values
        crosses = values.min() < 0.0 < values.max()
        return np.append(np.abs(values), 0.0) if crosses else np.abs(values)


def _within(asked: FloatArray, known: FloatArray) -> bool:
    margin = RANGE_TOLERANCE * np.abs([known.min(), known.max()]).max()
    return bool(known.min() - margin <= asked.min() and asked.max() <= known.max() + margin)
