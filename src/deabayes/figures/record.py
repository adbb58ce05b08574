"""A record with its prediction, in the units and the part that a panel shows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import xarray as xr

from deabayes.experiment import FloatArray
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import ROLES, DisplayUnit, display_unit, plain

DECADES = 30.0
"""Ratio of largest to smallest frequency, or time since a step, of a logarithmic axis."""
ROUNDING = 1e-6
"""Share of the time after a step within which a reading counts as one at the step itself."""
CYCLES, CYCLES_SHOWN = ("sine", "load_unload"), 3
GAP = 3.0
"""A step of more than this many median spacings between two points is a gap."""
SMALLEST = 0.05
"""Smallest response, as a share of a display unit, that is still shown in that unit."""


@dataclass(frozen=True)
class Axis:
    """Values to plot in display units, their label, and whether the axis is logarithmic."""

    values: FloatArray
    label: str
    logarithmic: bool = False


@dataclass(frozen=True)
class Record:
    """One prediction file, in display units.

    `shown` is the part that a panel shows. It is the whole record, or the last cycles of a long
    sine, or the points after the last gap of a sine with gaps, or the points after a step on a
    logarithmic axis.
    """

    prediction: xr.Dataset
    beside: float = 0.0
    """Largest observed response (SI) among the records with the same response name."""

    @property
    def name(self) -> str:
        return str(self.prediction.attrs["experiment"])

    @property
    def role(self) -> str:
        """Role of the record in words."""
        return ROLES[str(self.prediction.attrs["role"])]

    @property
    def protocol(self) -> str:
        return str(self.prediction.attrs["protocol"])

    @property
    def extrapolation(self) -> str:
        return str(self.prediction.attrs.get("extrapolation", ""))

    @property
    def response_name(self) -> str:
        return str(self.prediction.attrs["response_name"])

    @property
    def largest(self) -> float:
        """Largest magnitude of the observed response (SI)."""
        return float(np.nanmax(np.abs(self.prediction["observed"].values), initial=0.0))

    @property
    def unit(self) -> DisplayUnit:
        """Display unit of the records beside it, or its own if the response is too small."""
        kind = str(self.prediction.attrs["response_unit"])
        theirs = display_unit(kind, max(self.largest, self.beside), self.response_name)
        if self.largest >= SMALLEST * theirs.factor:
            return theirs
        return display_unit(kind, self.largest, self.response_name)

    @property
    def label(self) -> str:
        return plain(self.response_name) + self.unit.suffix

    @property
    def spans_decades(self) -> bool:
        """Whether the response axis is logarithmic, as it is for a gain."""
        return self.response_name == "gain"

    @property
    def responds(self) -> bool:
        """Whether the prediction has a finite median; it has none if every draw failed."""
        return bool(np.isfinite(self.prediction["median"].values).any())

    def whole(self, name: str, **selection: object) -> FloatArray:
        """Variable `name` over the whole record, in the display unit of the response."""
        variable = self.prediction[name].sel(**selection) if selection else self.prediction[name]
        return np.asarray(variable.values, dtype=float) / self.unit.factor

    def response(self, name: str, **selection: object) -> FloatArray:
        """Variable `name` over the part of the record that is shown, in display units."""
        return self.whole(name, **selection)[..., self.shown]

    def whole_band(self, name: str) -> FloatArray:
        """Lower and upper end (2, N) of a 90 % band over the whole record, in display units."""
        return np.stack([self.whole(name, level=0.9, bound=b) for b in ("lower", "upper")])

    def band(self, name: str) -> FloatArray:
        """Lower and upper end (2, N) of a 90 % band over the part of the record that is shown."""
        return self.whole_band(name)[:, self.shown]

    @property
    def shown(self) -> slice:
        time = self.prediction["coordinate"].values
        if np.isfinite(self.step):
            return slice(self._after(self.step), None)
        if self.protocol == "sine" and (last := after_last_gap(time)):
            return slice(last, None)
        crossings = passes(time, self.prediction["excitation"].values)
        if self.protocol != "sine" or len(crossings) <= CYCLES_SHOWN + 2:
            return slice(None)
        shown = CYCLES_SHOWN * usual_period(crossings)
        return slice(int(np.searchsorted(time, time[-1] - shown)), None)

    @property
    def step(self) -> float:
        """Start of the excitation's only step [s], if readings span decades after it; else NaN."""
        step = float(self.prediction.attrs.get("step", np.nan))
        since = self.prediction["coordinate"].values[self._after(step) :] - step
        is_shown = self.protocol not in CYCLES and _spans_decades(since)
        return step if is_shown else float("nan")

    def _after(self, step: float) -> int:
        """Index of the first reading after a step; the number of readings if the step is NaN."""
        time = self.prediction["coordinate"].values
        return int(np.searchsorted(time, step + ROUNDING * (time[-1] - step), side="right"))

    def against_coordinate(self) -> Axis:
        """Axis of the coordinate: time, frequency, or the excitation of a record without time.

        After a step, it is the time since the step. This time and a frequency are logarithmic.
        """
        coordinate = self.prediction["coordinate"]
        values, unit = coordinate.values[self.shown], _unit(coordinate)
        name = str(coordinate.attrs.get("name", "coordinate"))
        if np.isfinite(self.step):
            return _axis(values - self.step, name, unit, True, since=" since the step")
        return _axis(values, name, unit, name == "frequency" and _spans_decades(values[values > 0]))

    def horizontal(self) -> Axis:
        """Horizontal axis: the excitation for a `load_unload` record, else the coordinate."""
        if self.protocol != "load_unload":
            return self.against_coordinate()
        excitation = self.prediction["excitation"]
        name = str(excitation.attrs.get("name", excitation.attrs.get("long_name", "excitation")))
        return _axis(excitation.values[self.shown], name, _unit(excitation))


def side_by_side(predictions: Iterable[xr.Dataset]) -> list[Record]:
    """Records that share a display unit per response, so that they can be compared by eye."""
    alone = [Record(prediction) for prediction in predictions]
    largest: dict[str, float] = {}
    for each in alone:
        name = each.response_name
        largest[name] = max(each.largest, largest.get(name, 0.0))
    return [replace(each, beside=largest[each.response_name]) for each in alone]


def _unit(variable: xr.DataArray) -> str:
    return str(variable.attrs.get("unit", variable.attrs.get("units", "1")))


def _spans_decades(positive: FloatArray) -> bool:
    return bool(positive.size and positive.max() > DECADES * positive.min() > 0.0)


def _axis(
    values: FloatArray, name: str, unit: str, logarithmic: bool = False, since: str = ""
) -> Axis:
    display = display_unit(unit, values, name)
    return Axis(values / display.factor, plain(name) + since + display.suffix, logarithmic)


def after_last_gap(coordinate: FloatArray) -> int:
    """Index of the first point after the last gap between points; 0 without a gap."""
    steps = np.diff(coordinate)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) if steps.size else steps
    return int(gaps[-1]) + 1 if gaps.size else 0


def branches(values: FloatArray) -> Iterator[slice]:
    """Monotone stretches of `values`: the loading and unloading branches of a loop."""
    steps = np.sign(np.diff(values))
    steps = steps[steps != 0] if not steps.any() else _filled(steps)
    turns = np.flatnonzero(np.diff(steps)) + 1
    edges = [0, *turns.tolist(), len(values) - 1]
    for start, stop in pairwise(edges):
        yield slice(start, stop + 1)


def _filled(steps: FloatArray) -> FloatArray:
    """Replace zero steps by the sign of the step before them."""
    index = np.maximum.accumulate(np.where(steps != 0, np.arange(steps.size), 0))
    return steps[index]
