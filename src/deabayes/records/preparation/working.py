"""The state of a record between two preparation steps, and the settings of a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Nodes, Specimen
from deabayes.faults import Report, UserError, nearest
from deabayes.quantities import taken_in_si
from deabayes.records.channels import excitation_range, usual_interval
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.units import parse_quantity

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
START_FRACTIONS = (0.02, 0.04)
EXCITATION_COLUMN = "excitation_column"
NOT_CONDITIONS = ("note", EXCITATION_COLUMN)


@dataclass(frozen=True)
class WorkingRecord:
    """One record between two preparation steps, in SI units.

    The excitation and the response have separate coordinates. Masking, shifting or averaging the
    response therefore never removes a measured part of the excitation's history, on which every
    later response depends.

    Attributes
    ----------
    row, specimen : the record's row of experiments.csv, and the specimen that was tested.
    coordinate_name, coordinate_unit : time [s], or the excitation for a quasi-static record.
    response_unit, excitation_unit : SI units of the channels.
    coordinate, response, used : (M,) the response, and whether the likelihood may see each
        sample.
    samples_averaged : (M,) raw samples behind each value of the response.
    nodes : where to evaluate a model to average it like the samples; None if nothing was
        averaged.
    excitation_coordinate, excitation : (K,) the driving channel, linear between its knots.
    delay : how far the response has been shifted towards earlier times [coordinate].
    steps : one entry per finished step: `step`, `settings`, `effect` and `masked`, the masked
        intervals on the raw file's coordinate.
    report : takes what a user must know before trusting the record; all states share it.
    bare_numbers : takes a warning on each setting without a unit, which a step reads as SI.
    remarks : what the current step reports for its entry in `steps`. `effect` and `masked` are
        added to what `with_step` finds itself; other keys are entered unchanged.
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
    report: Report = field(default_factory=Report)
    bare_numbers: Report = field(default_factory=Report)
    remarks: Mapping[str, Any] = field(default_factory=dict)

    @property
    def in_time(self) -> bool:
        """Whether the coordinate is time rather than the excitation or a frequency."""
        return self.coordinate_name == "time"

    @property
    def excitation_range(self) -> float:
        """Largest change of the excitation; for a step at the first sample, its largest size."""
        return excitation_range(self.row.protocol, self.excitation, self.excitation_unit)

    @property
    def interval(self) -> float:
        """Median distance of neighbouring samples of the response."""
        return usual_interval(self.coordinate)

    def mask(self, hidden: BoolArray, **changes: object) -> WorkingRecord:
        """Hide samples (M,) from the likelihood; hidden samples stay hidden."""
        return replace(self, used=self.used & ~hidden, **changes)  # type: ignore[arg-type]

    def with_step(
        self, name: str, settings: Mapping[str, object], before: WorkingRecord
    ) -> WorkingRecord:
        """Add a finished step to the history, with its effect compared with `before`."""
        masked: list[list[float]] = []
        if before.coordinate.size == self.coordinate.size:
            masked = intervals(before.coordinate + before.delay, before.used & ~self.used)
        remarks = dict(self.remarks)
        effect = [_effect(before, self), remarks.pop("effect", "")]
        entry = {
            "step": name,
            "settings": dict(settings),
            "effect": "; ".join(filter(None, effect)),
            "masked": [*masked, *remarks.pop("masked", [])],
            **remarks,
        }
        return replace(self, steps=(*self.steps, entry), remarks={})

    def excitation_start(self) -> float:
        """Coordinate of the last knot before the excitation leaves its first value.

        A line through the crossings of 2 and 4 % of the excitation's range is extended back to
        the first value. Noise on a monitored voltage is thereby ignored, and the start of a ramp
        is not found too late.
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
    """Where `departure` first exceeds `level`, linear between knots; the first knot if nowhere."""
    above = np.flatnonzero(departure > level)
    if above.size == 0 or above[0] == 0:
        return float(coordinate[0])
    first = int(above[0])
    share = (level - departure[first - 1]) / (departure[first] - departure[first - 1])
    return float(coordinate[first - 1] + share * (coordinate[first] - coordinate[first - 1]))


def intervals(coordinate: FloatArray, flags: BoolArray) -> list[list[float]]:
    """Return the runs of true `flags` (M,) as [first, last] coordinates."""
    padded = np.concatenate([[False], flags, [False]]).astype(int)
    change = np.diff(padded)
    first, last = np.flatnonzero(change == 1), np.flatnonzero(change == -1) - 1
    return [[float(coordinate[a]), float(coordinate[b])] for a, b in zip(first, last, strict=True)]


def _effect(before: WorkingRecord, after: WorkingRecord) -> str:
    """Describe in one line what changed between two states of a record."""
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


def coordinate_name(row: ExperimentRow) -> str:
    """Name of the coordinate: time, or the excitation if the record has no time."""
    return row.excitation if row.protocol in ("quasi_static", "frequency_response") else "time"


def open_record(
    row: ExperimentRow, raw: RawRecord, specimen: Specimen, bare_numbers: Report | None = None
) -> WorkingRecord:
    """Return the channels of a record that its row names.

    A command (`control_voltage`) is used as the excitation that it asks for.

    A record without time is sorted by its coordinate. A phase is known only up to whole turns
    and is made continuous (see `continuous_phase`).
    """
    name = coordinate_name(row)
    coordinate = np.asarray(raw.columns[name], dtype=float)
    record = WorkingRecord(
        row=_as_excitation(row),
        specimen=specimen,
        coordinate_name=name,
        coordinate_unit=raw.units[name],
        response_unit=raw.units[row.response],
        excitation_unit=raw.units[row.excitation],
        coordinate=coordinate,
        response=np.asarray(raw.columns[row.response], dtype=float),
        used=np.ones(coordinate.size, dtype=bool),
        samples_averaged=np.ones(coordinate.size),
        excitation_coordinate=coordinate,
        excitation=np.asarray(raw.columns[row.excitation], dtype=float),
        bare_numbers=bare_numbers or Report(),
    )
    if record.in_time:
        return record
    record = _ascending(record)
    if row.response != "phase":
        return record
    return replace(record, response=continuous_phase(record.response))


def _as_excitation(row: ExperimentRow) -> ExperimentRow:
    """Replace a command by the excitation it asks for, and note the column in the metadata."""
    if row.excitation not in COMMANDS:
        return row
    metadata = {**row.metadata, EXCITATION_COLUMN: row.excitation}
    return replace(row, excitation=COMMANDS[row.excitation], metadata=metadata)


def continuous_phase(phase: FloatArray) -> FloatArray:
    """Return the phase [rad] without jumps of a turn, with its first value in (-3/4, 1/4] turn.

    An actuator lags. The quarter turn above zero allows for noise and rounding.
    """
    unwrapped = np.unwrap(phase)
    turn = 2.0 * np.pi
    return np.asarray(unwrapped - turn * np.ceil((unwrapped[0] - 0.25 * turn) / turn))


def _ascending(record: WorkingRecord) -> WorkingRecord:
    """Sort a record without time by its coordinate."""
    steps = np.diff(record.coordinate)
    if np.all(steps >= 0.0):
        return record
    order = np.argsort(record.coordinate, kind="stable")
    ordered = replace(
        record,
        coordinate=record.coordinate[order],
        response=record.response[order],
        excitation_coordinate=record.coordinate[order],
        excitation=record.excitation[order],
    )
    if np.all(steps <= 0.0):
        return ordered
    loaded = record.row.protocol == "quasi_static"
    mixed = ", so that loading and unloading are mixed" if loaded else ""
    record.report.warn(
        f"{record.coordinate_name} goes back and forth; samples were put in ascending order{mixed}"
    )
    return ordered


def conditions(row: ExperimentRow, raw: RawRecord) -> dict[str, float | str]:
    """Return what was held constant: the row's metadata, and the voltage of a pull test [V].

    The column `voltage` has priority over `voltage_kV`. `check_record` checks that the voltage
    is constant.
    """
    constant = {key: value for key, value in row.metadata.items() if key not in NOT_CONDITIONS}
    if row.protocol != "quasi_static" or row.excitation == "voltage":
        return constant
    if "voltage" in raw.columns:
        constant["voltage"] = float(np.mean(raw.columns["voltage"]))
    elif "voltage_kV" in constant:
        constant["voltage"] = 1000.0 * float(constant["voltage_kV"])
    return constant


class Settings:
    """The settings of one step on one record; every mistake is a `UserError` that names its key.

    Parameters
    ----------
    step : the step's name in config.
    settings : the mapping written under it.
    record : the record that the step will change.
    known : keys the step understands.
    """

    def __init__(
        self,
        step: str,
        settings: Mapping[str, object],
        record: WorkingRecord,
        known: Sequence[str] = (),
    ) -> None:
        self.where = f"preparation of {record.row.name} ({record.row.protocol}), {step}"
        self.entry = f"preparation.{record.row.protocol}, {step}"
        self.values = settings
        self.record = record
        for key in settings:
            if key not in known:
                hint = nearest(str(key), known) if known else "; the step takes no settings"
                raise UserError(f"{self.where}: unknown setting {key!r}{hint}")

    def has(self, key: str) -> bool:
        """Whether the key has a value."""
        return self.values.get(key) is not None

    def at_most_one(self, *keys: str) -> None:
        """Refuse more than one of several alternative settings."""
        given = [key for key in keys if self.has(key)]
        if len(given) > 1:
            raise UserError(
                f"{self.where}: {' and '.join(map(repr, given))} cannot both be given; remove one"
            )

    def of_another(self) -> bool:
        """Whether the step is meant for another record or response."""
        row = self.record.row
        mine = {"record": row.name, "response": row.response}
        return any(self.has(key) and str(self.values[key]) != own for key, own in mine.items())

    def quantity(self, key: str, unit: str, default: float | None = None) -> float:
        """Return a quantity in SI; it must have the dimension of `unit`."""
        if not self.has(key):
            if default is None:
                raise UserError(f"{self.where}: needs {key!r}, a quantity in {unit}; add it")
            return default
        value = self.values[key]
        if unit != "1" and isinstance(value, Real) and value:
            note = taken_in_si(value, unit, f"{self.entry}.{key}")
            self.record.bare_numbers.include(warnings=[note])
        return parse_quantity(value, unit, f"{self.where}.{key}")  # type: ignore[arg-type]

    def positive(self, key: str, unit: str, default: float | None = None) -> float:
        """Return a quantity that must be larger than zero."""
        value = self.quantity(key, unit, default)
        if not value > 0.0:
            raise UserError(f"{self.where}.{key}: must be larger than 0, found {value:g} {unit}")
        return value

    def number(self, key: str, default: float, lower: float, upper: float) -> float:
        """Return a plain number, which must lie within [lower, upper]."""
        value = self.quantity(key, "1", default)
        if not lower <= value <= upper:
            raise UserError(
                f"{self.where}.{key}: must lie between {lower:g} and {upper:g}, found {value:g}"
            )
        return value

    def count(self, key: str, default: int | None = None, lowest: int = 1) -> int:
        """Return a whole number, which must be at least `lowest`."""
        value = self.values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < lowest:
            raise UserError(
                f"{self.where}.{key}: expected a whole number >= {lowest}, found {value!r}"
            )
        return value

    def choice(self, key: str, options: Sequence[str], default: str | None = None) -> str:
        """Return a value that must be one of `options`."""
        value = self.values.get(key, default)
        if value not in options:
            hint = nearest(str(value), options)
            raise UserError(f"{self.where}.{key}: {value!r} is not possible here{hint}")
        return str(value)

    def coordinate(self, key: str, default: float | None = None) -> float:
        """Return a place on the record's coordinate.

        With `from_step: true` the value counts from the start of the excitation.
        """
        value = self.quantity(key, self.record.coordinate_unit, default)
        return value + self.record.excitation_start() if self.flag("from_step") else value

    def flag(self, key: str) -> bool:
        """Return a switch, false if not given."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            raise UserError(f"{self.where}.{key}: expected true or false, found {value!r}")
        return value
