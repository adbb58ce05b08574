"""Specimens and prepared records, in SI units, ready for inference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Role = Literal["calibrate", "validate"]
PROTOCOLS = (
    "creep",
    "step",
    "sine",
    "sweep",
    "frequency_response",
    "quasi_static",
    "relaxation",
    "load_unload",
)


FREQUENCY_RESPONSE = {"frequency": "Hz", "gain": "1/V", "phase": "rad"}
"""Channels of a frequency response, its excitation first -> SI unit."""
PHASE = "_phase"
"""The name of a phase record is that of the gain record plus this ending."""
ONSET_SHARE = 0.02
SETTLED_SHARE, OVERSHOOT, LONG_HOLD = 0.05, 0.2, 10.0
"""Of a step: distance from its last value that still counts as settled and largest overshoot, as
shares of its height; least length of the hold after it, as a multiple of its own length."""


@dataclass(frozen=True)
class Quantity:
    """A property of the specimen in SI units; without `sd` it counts as exact."""

    value: float
    unit: str
    sd: float | None = None
    source: str = ""


@dataclass(frozen=True)
class Specimen:
    """One tested piece: its system, its provenance and its quantities (SI).

    `provenance` holds `kind` (measured | simulated | digitised), `source`,
    `licence`; `instruments` maps a name (`delay`, `range`, `resolution`,
    `noise`, `current_limit`) to a quantity.
    """

    name: str
    system: str
    provenance: Mapping[str, str]
    quantities: Mapping[str, Quantity]
    instruments: Mapping[str, Quantity] = field(default_factory=dict)


@dataclass(frozen=True)
class Excitation:
    """A driving signal, linear between its knots.

    Attributes
    ----------
    name, unit : the driven channel (`voltage`, `stretch`, `displacement`, ...) and its SI unit.
    coordinate : (K,) knots, seconds for a history in time; for a quasi-static
        record, which has no time, the knots are the excitation itself.
    values : (K,) the channel at the knots, SI.
    conditions : conditions that are constant during the record (`load_g`, `deformation`, ...).
    in_time : whether the knots are times; without them they are the excitation itself.
    noisy : whether the values are a monitor's readings. A small scatter about a smooth curve then
        is noise of the monitor.
    """

    name: str
    unit: str
    coordinate: FloatArray
    values: FloatArray
    conditions: Mapping[str, float | str] = field(default_factory=dict)
    in_time: bool = True
    noisy: bool = False

    def at(self, coordinate: FloatArray) -> FloatArray:
        """The channel at `coordinate`, by linear interpolation."""
        return np.interp(coordinate, self.coordinate, self.values)

    @property
    def without_time(self) -> bool:
        """Whether the knots are the excitation itself: a quasi-static record."""
        return not self.in_time or self.conditions.get("protocol") == "quasi_static"

    @property
    def onset(self) -> float:
        """The last knot before the signal leaves its first value; the first knot if it never does.

        It has left its first value at 2 % of its largest departure from it.
        """
        departure = np.abs(self.values - self.values[0])
        left = np.flatnonzero(departure > ONSET_SHARE * departure.max())
        return float(self.coordinate[max(int(left[0]) - 1, 0) if left.size else 0])

    @property
    def starts_applied(self) -> bool:
        """Whether it is a voltage that is not zero at its first knot; it was zero before."""
        largest = float(np.abs(self.values).max())
        return self.unit == "V" and abs(float(self.values[0])) > ONSET_SHARE * largest

    @property
    def start(self) -> float:
        """Coordinate at which something first happens: the first knot or the onset."""
        return float(self.coordinate[0]) if self.starts_applied else self.onset

    def settled(self, height: float) -> float:
        """Knot from which the signal stays within 5 % of `height` of its last value."""
        away = np.flatnonzero(np.abs(self.values - self.values[-1]) > SETTLED_SHARE * height)
        return float(self.coordinate[int(away[-1]) + 1 if away.size else 0])

    @property
    def step(self) -> float:
        """Time at which its only step begins [s]; NaN without a step, with several, without time.

        A step is a change to a last value at which the signal stays, for at least ten times as
        long as the change took. A voltage that is constant steps at its first knot.
        """
        before, start = float(self.values[0]), self.onset
        if self.starts_applied and self.conditions.get("prehistory") != "equilibrium":
            before, start = 0.0, self.start
        height = abs(float(self.values[-1]) - before)
        largest = float(np.abs(self.values - before).max())
        if self.without_time or height == 0.0 or largest > (1.0 + OVERSHOOT) * height:
            return float("nan")
        end, settled = float(self.coordinate[-1]), self.settled(height)
        is_held = end - settled >= LONG_HOLD * max(settled - start, 0.0)
        return start if is_held else float("nan")


@dataclass(frozen=True)
class Nodes:
    """Where the model is evaluated for each point of a record of averaged samples.

    Attributes
    ----------
    point : (M,) index of the point to which a node belongs, ascending; every point has nodes.
    offsets : (M,) distance of the node behind the point's coordinate.
    shares : (M,) weights of the model's values at the nodes in the value compared with the point.
    """

    point: NDArray[np.intp]
    offsets: FloatArray
    shares: FloatArray

    def at(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Nodes:
        """Return the nodes of some points, which are renumbered in ascending order."""
        count = int(self.point[-1]) + 1
        kept = np.zeros(count, dtype=bool)
        kept[which] = True
        own = kept[self.point]
        renumbered = np.cumsum(kept) - 1
        return Nodes(renumbered[self.point[own]], self.offsets[own], self.shares[own])

    @property
    def starts(self) -> NDArray[np.intp]:
        """Index of the first node of every point, (N,)."""
        return np.searchsorted(self.point, np.arange(int(self.point[-1]) + 1))


@dataclass(frozen=True)
class Experiment:
    """One prepared record.

    Attributes
    ----------
    coordinate : (N,) coordinate of the readings: time [s], the excitation of a quasi-static
        record, or the frequency of a frequency response.
    response : (N,) measured response, SI, each the mean of `samples_averaged` raw samples.
    metadata : further columns of experiments.csv.
    steps : the preparation steps with their settings, in order.
    warnings : sentences a user must know before trusting the record.
    nodes : where the model is evaluated, to be averaged like the samples; None if the model is
        evaluated at `coordinate`.

    The excitation is a history in time if the coordinate is time.
    """

    name: str
    protocol: str
    role: Role
    coordinate_name: str
    coordinate_unit: str
    coordinate: FloatArray
    response_name: str
    response_unit: str
    response: FloatArray
    samples_averaged: FloatArray
    excitation: Excitation
    metadata: Mapping[str, float | str] = field(default_factory=dict)
    provenance: str = "measured"
    record_sha256: str = ""
    steps: tuple[Mapping[str, object], ...] = ()
    warnings: tuple[str, ...] = ()
    nodes: Nodes | None = None

    def __post_init__(self) -> None:
        driven = replace(self.excitation, in_time=self.coordinate_name == "time")
        object.__setattr__(self, "excitation", driven)

    @property
    def row(self) -> str:
        """Name of its row in experiments.csv; a gain and its phase share a row."""
        return self.name.removesuffix(PHASE) if self.response_name == "phase" else self.name

    @property
    def elapsed(self) -> float:
        """Time from the start of the excitation to the last reading [s]; NaN without a time axis.

        A voltage is zero before its first knot. If it is not zero at this knot, it begins there.
        """
        if self.coordinate_name != "time":
            return float("nan")
        return float(np.max(self.coordinate)) - self.excitation.start

    @property
    def response_range(self) -> float:
        """max y - min y, the scale of the papers' relative errors."""
        return float(np.max(self.response) - np.min(self.response))
