"""What was tested and what was recorded, in SI units, ready for inference."""

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
"""What the name of a gain's phase has behind that of the gain."""
ONSET_SHARE = 0.02


@dataclass(frozen=True)
class Quantity:
    """A property of the specimen in SI units; `sd` None means it is taken as exact."""

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
    conditions : what was held during the record (`load_g`, `deformation`, ...).
    in_time : whether the knots are times; without them they are the excitation itself.
    noisy : whether the values are a monitor's readings: a little scatter about a smooth curve is
        the monitor's then, and not driven.
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
        """The last knot before it leaves its first value by 2 % of its largest departure.

        Its first knot if it never does.
        """
        departure = np.abs(self.values - self.values[0])
        left = np.flatnonzero(departure > ONSET_SHARE * departure.max())
        return float(self.coordinate[max(int(left[0]) - 1, 0) if left.size else 0])


@dataclass(frozen=True)
class Nodes:
    """Where the model is evaluated for each point, whose samples were averaged.

    Attributes
    ----------
    point : (M,) the point that a node is of, ascending; every point has one.
    offsets : (M,) from the point's coordinate on.
    shares : (M,) of the model's value there in what is compared with the point.
    """

    point: NDArray[np.intp]
    offsets: FloatArray
    shares: FloatArray

    def at(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Nodes:
        """Those of some points, in ascending order."""
        count = int(self.point[-1]) + 1
        kept = np.zeros(count, dtype=bool)
        kept[which] = True
        own = kept[self.point]
        renumbered = np.cumsum(kept) - 1
        return Nodes(renumbered[self.point[own]], self.offsets[own], self.shares[own])

    @property
    def starts(self) -> NDArray[np.intp]:
        """The first node of every point, (N,)."""
        return np.searchsorted(self.point, np.arange(int(self.point[-1]) + 1))


@dataclass(frozen=True)
class Experiment:
    """One prepared record.

    Attributes
    ----------
    coordinate : (N,) where the response was taken: time [s], or the excitation
        itself for a quasi-static record, the frequency for a frequency response.
    response : (N,) measured response, SI, each the mean of `samples_averaged` raw samples.
    metadata : further columns of experiments.csv.
    steps : the preparation steps with their settings, in order.
    warnings : what a user must know before trusting the record.
    nodes : where the model is averaged as the samples were; None where it is taken at
        `coordinate` itself.

    Its excitation is in time where its coordinate is.
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
        """The row of experiments.csv that it is of; a gain and its phase are of one."""
        return self.name.removesuffix(PHASE) if self.response_name == "phase" else self.name

    @property
    def elapsed(self) -> float:
        """From the onset of the excitation to the last reading [s]; NaN without a time axis.

        A voltage is zero before its first knot, so that one which is not zero there begins there.
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
