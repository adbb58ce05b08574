"""A record on its way from the file to the likelihood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Nodes, Specimen
from deabayes.reading.held import excitation_range
from deabayes.reading.raw import ExperimentRow

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
START_FRACTIONS = (0.02, 0.04)


@dataclass(frozen=True)
class WorkingRecord:
    """One record between two preparation steps; SI throughout.

    The excitation and the response live on coordinates of their own: masking,
    shifting or averaging the response never removes a measured part of the
    excitation's history, on which every later response depends.

    Attributes
    ----------
    row, specimen : what the record is of.
    coordinate_name, coordinate_unit : time [s], or the excitation for a quasi-static record.
    response_unit, excitation_unit : SI units of the channels.
    coordinate, response, used : (M,) the response, and which samples the likelihood may see.
    samples_averaged : (M,) raw samples behind each value of the response.
    nodes : where a model is averaged as these were; None where nothing was averaged.
    excitation_coordinate, excitation : (K,) the driving channel, linear between its knots.
    delay : how far the response has been shifted towards earlier times [coordinate].
    steps : per step done: `step`, `settings`, `effect` and `masked`, the masked
        intervals on the raw file's coordinate.
    warnings : what a user must know before trusting the record.
    remarks : what the step being done says of itself, for its entry in `steps`: `effect` and
        `masked` are joined to what is seen from outside, other keys are entered as they are.
    """

    row: ExperimentRow
    specimen: Specimen
    coordinate_name: str
    coordinate_unit: str
    response_unit: str
    excitation_unit: str
    coordinate: FloatArray
    response: FloatArray
    used: BoolArray
    samples_averaged: FloatArray
    excitation_coordinate: FloatArray
    excitation: FloatArray
    nodes: Nodes | None = None
    delay: float = 0.0
    steps: tuple[Mapping[str, object], ...] = ()
    warnings: tuple[str, ...] = ()
    remarks: Mapping[str, Any] = field(default_factory=dict)

    @property
    def in_time(self) -> bool:
        """Whether the coordinate is time rather than the excitation or a frequency."""
        return self.coordinate_name == "time"

    @property
    def excitation_range(self) -> float:
        """Largest change of the excitation, that to its first sample where it is a step there."""
        return excitation_range(self.row.protocol, self.excitation, self.excitation_unit)

    def mask(self, hidden: BoolArray, **changes: object) -> WorkingRecord:
        """Hide samples (M,) from the likelihood; none becomes visible again."""
        return replace(self, used=self.used & ~hidden, **changes)  # type: ignore[arg-type]

    def with_warning(self, warning: str) -> WorkingRecord:
        """The record with one more warning."""
        return replace(self, warnings=(*self.warnings, warning))

    def with_step(
        self, name: str, settings: Mapping[str, object], before: WorkingRecord
    ) -> WorkingRecord:
        """Enter a finished step into the history, with what it did to `before`."""
        masked: list[list[float]] = []
        if before.coordinate.size == self.coordinate.size:
            masked = intervals(before.coordinate + before.delay, before.used & ~self.used)
        said = dict(self.remarks)
        effect = [_effect(before, self), said.pop("effect", "")]
        entry = {
            "step": name,
            "settings": dict(settings),
            "effect": "; ".join(filter(None, effect)),
            "masked": [*masked, *said.pop("masked", [])],
            **said,
        }
        return replace(self, steps=(*self.steps, entry), remarks={})

    def excitation_start(self) -> float:
        """Coordinate of the last knot before the excitation leaves its first value.

        The line through its crossings of 2 and 4 % of its range, extended back to
        its first value: noise on a monitored voltage does not count, and a ramp
        is not taken to start late.
        """
        departure = np.abs(self.excitation - self.excitation[0])
        low, high = (
            _crossing(self.excitation_coordinate, departure, share * float(departure.max()))
            for share in START_FRACTIONS
        )
        start = low - (high - low) * START_FRACTIONS[0] / (START_FRACTIONS[1] - START_FRACTIONS[0])
        slack = 1e-6 * (high - low)
        before = np.searchsorted(self.excitation_coordinate, start + slack, side="right") - 1
        return float(self.excitation_coordinate[max(int(before), 0)])


def _crossing(coordinate: FloatArray, departure: FloatArray, level: float) -> float:
    """Where `departure` first exceeds `level`, linear between knots; the start if nowhere."""
    above = np.flatnonzero(departure > level)
    if above.size == 0 or above[0] == 0:
        return float(coordinate[0])
    first = int(above[0])
    share = (level - departure[first - 1]) / (departure[first] - departure[first - 1])
    return float(coordinate[first - 1] + share * (coordinate[first] - coordinate[first - 1]))


def intervals(coordinate: FloatArray, flags: BoolArray) -> list[list[float]]:
    """Runs of true `flags` (M,) as [first, last] coordinates."""
    padded = np.concatenate([[False], flags, [False]]).astype(int)
    change = np.diff(padded)
    first, last = np.flatnonzero(change == 1), np.flatnonzero(change == -1) - 1
    return [[float(coordinate[a]), float(coordinate[b])] for a, b in zip(first, last, strict=True)]


def _effect(before: WorkingRecord, after: WorkingRecord) -> str:
    """One line on what changed between two states of a record."""
    parts = []
    if after.coordinate.size != before.coordinate.size:
        parts.append(f"{int(before.used.sum())} samples to {after.coordinate.size} points")
    elif (hidden := int(before.used.sum() - after.used.sum())) > 0:
        parts.append(f"masked {hidden} of {before.used.size} samples")
    if after.excitation.size != before.excitation.size:
        parts.append(f"excitation from {before.excitation.size} to {after.excitation.size} knots")
    if after.delay != before.delay:
        parts.append(f"response {after.delay - before.delay:g} {after.coordinate_unit} earlier")
    if not parts and not np.array_equal(after.response, before.response):
        shift = float(np.mean(after.response - before.response))
        parts.append(f"response shifted by {shift:.4g} {after.response_unit}")
    return "; ".join(parts) or "no change"
