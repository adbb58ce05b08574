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
        """Time from the onset of the excitation to the last reading [s]; NaN without a time axis.

        A voltage is zero before its first knot. If it is not zero at this knot, it begins there.
        """
        if self.coordinate_name != "time":
            return float("nan")
        driven, last = self.excitation, float(np.max(self.coordinate))
        applied = driven.unit == "V" and (
            abs(driven.values[0]) > ONSET_SHARE * np.abs(driven.values).max()
        )
        return last - (float(driven.coordinate[0]) if applied else driven.onset)

    @property
    def response_range(self) -> float:
        """max y - min y, the scale of the papers' relative errors."""
        return float(np.max(self.response) - np.min(self.response))
