"""The region that calibration records span, and warnings for predictions outside that region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.prediction.noise_origin import CalibratedRecord, fastest
from deabayes.systems.base import System

LONGEST_EXTRAPOLATION = 1.5
FASTEST_EXTRAPOLATION = 1.5
RANGE_TOLERANCE = 0.01
Held = Mapping[str, float | str]


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
            self._span(experiment),
            self._rate(experiment),
        )
        return "; ".join(note for note in notes if note)

    def _range(self, experiment: Experiment) -> str:
        driven = experiment.excitation
        ends = [
            [r.lowest, r.highest] + [0.0] * _from_rest(driven.unit, r.coordinate_name)
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
        asked = self._held(driven.name, driven.conditions)
        calibrated = [
            self._held(r.excitation_name, r.conditions)
            for r in self.records
            if r.conditions is not None
        ]
        known = {name: [c[name] for c in calibrated if name in c] for name in asked}
        return [self._condition(name, asked[name], known[name]) for name in asked if known[name]]

    def _condition(self, name: str, asked: float | str, known: Sequence[float | str]) -> str:
        numbers = [each for each in known if not isinstance(each, str)]
        if isinstance(asked, str) or not numbers:
            words = ", ".join(sorted({str(each) for each in known}))
            return "" if asked in known else f"{name} {asked} was not calibrated ({words} was)"
        values = self._folded(name, np.array(numbers, dtype=float))
        value = self._folded(name, np.array([asked], dtype=float))
        if _within(value, values):
            return ""
        channel = self.system.excitations.get(name, "1")
        unit = "" if channel == "1" else f" {channel}"
        ends = dict.fromkeys(f"{end:.5g}" for end in (values.min(), values.max()))
        return f"{name} {value[0]:.5g}{unit} lies outside the calibrated {' to '.join(ends)}{unit}"

    def _held(self, excitation: str, conditions: Held) -> Held:
        """Return the conditions that responses depend on, as far as they are known."""
        names = (self.system.conditions or {}).get(excitation, {})
        held = {name: conditions.get(name, unstated) for name, unstated in names.items()}
        return {name: value for name, value in held.items() if value is not None}

    def _span(self, experiment: Experiment) -> str:
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

    def _rate(self, experiment: Experiment) -> str:
        rate = fastest(experiment)
        known = max(
            (r.fastest for r in self.records if r.coordinate_name == "time"), default=np.nan
        )
        if not rate > FASTEST_EXTRAPOLATION * known:
            return ""
        shown, calibrated = (f"{float(f'{hertz:.2g}'):g} Hz" for hertz in (rate, known))
        return (
            f"it shows what happens at up to {shown}, the calibration records at up to {calibrated}"
        )

    def _folded(self, channel: str, values: FloatArray) -> FloatArray:
        """Return magnitudes if the sign makes no difference; add zero if both signs occur."""
        if channel not in self.system.even:
            return values
        crosses = values.min() < 0.0 < values.max()
        return np.append(np.abs(values), 0.0) if crosses else np.abs(values)


def _from_rest(unit: str, coordinate_name: str) -> bool:
    """Whether a record starts without excitation: a voltage is zero before its first knot."""
    return unit == "V" and coordinate_name == "time"


def _within(asked: FloatArray, known: FloatArray) -> bool:
    margin = RANGE_TOLERANCE * np.abs([known.min(), known.max()]).max()
    return bool(known.min() - margin <= asked.min() and asked.max() <= known.max() + margin)
