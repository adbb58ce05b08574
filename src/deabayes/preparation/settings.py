"""Reading a step's settings from config: known keys, units, allowed values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from numbers import Real

from deabayes.faults import UserError, nearest
from deabayes.preparation.working import WorkingRecord
from deabayes.quantities import taken_in_si
from deabayes.units import parse_quantity

_noted: ContextVar[dict[str, None] | None] = ContextVar("_noted", default=None)
"""What is said of numbers without a unit, where somebody listens."""


@contextmanager
def noting_bare_numbers() -> Iterator[dict[str, None]]:
    """Collect a sentence on each number that a step takes for a quantity in SI, as it has no unit.

    What is the same for several records of a protocol is there once, in order.
    """
    noted: dict[str, None] = {}
    before = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(before)


class Settings:
    """The settings of one step on one record; every mistake is a `UserError` naming its key.

    Parameters
    ----------
    step : the step's name in config.
    settings : the mapping written under it.
    record : the record the step is about to change.
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
        """Whether the key is given a value."""
        return self.values.get(key) is not None

    def at_most_one(self, *keys: str) -> None:
        """Refuse more than one of settings that each say the same in its own way."""
        given = [key for key in keys if self.has(key)]
        if len(given) > 1:
            raise UserError(
                f"{self.where}: {' and '.join(map(repr, given))} are given, and each stands in for "
                "the other; remove one"
            )

    def of_another(self) -> bool:
        """Whether the step is for another record or response than this one."""
        row = self.record.row
        mine = {"record": row.name, "response": row.response}
        return any(self.has(key) and str(self.values[key]) != own for key, own in mine.items())

    def quantity(self, key: str, unit: str, default: float | None = None) -> float:
        """A quantity in SI; `unit` is what its dimension must be."""
        if not self.has(key):
            if default is None:
                raise UserError(f"{self.where}: needs {key!r}, a quantity in {unit}; add it")
            return default
        value = self.values[key]
        noted = _noted.get()
        if noted is not None and unit != "1" and isinstance(value, Real) and value:
            noted[taken_in_si(value, unit, f"{self.entry}.{key}")] = None
        return parse_quantity(value, unit, f"{self.where}.{key}")  # type: ignore[arg-type]

    def positive(self, key: str, unit: str, default: float | None = None) -> float:
        """A quantity that must be larger than zero."""
        value = self.quantity(key, unit, default)
        if not value > 0.0:
            raise UserError(f"{self.where}.{key}: must be larger than 0, found {value:g} {unit}")
        return value

    def number(self, key: str, default: float, lower: float, upper: float) -> float:
        """A plain number within [lower, upper]."""
        value = self.quantity(key, "1", default)
        if not lower <= value <= upper:
            raise UserError(
                f"{self.where}.{key}: must lie between {lower:g} and {upper:g}, found {value:g}"
            )
        return value

    def count(self, key: str, default: int | None = None, lowest: int = 1) -> int:
        """A whole number of at least `lowest`."""
        value = self.values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < lowest:
            raise UserError(
                f"{self.where}.{key}: expected a whole number >= {lowest}, found {value!r}"
            )
        return value

    def choice(self, key: str, options: Sequence[str], default: str | None = None) -> str:
        """One of `options`."""
        value = self.values.get(key, default)
        if value not in options:
            hint = nearest(str(value), options)
            raise UserError(f"{self.where}.{key}: {value!r} is not possible here{hint}")
        return str(value)

    def coordinate(self, key: str, default: float | None = None) -> float:
        """A place on the record's coordinate, counted from its zero or, with
        `from_step: true`, from where the excitation starts."""
        value = self.quantity(key, self.record.coordinate_unit, default)
        return value + self.record.excitation_start() if self.flag("from_step") else value

    def flag(self, key: str) -> bool:
        """A switch, off unless given."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            raise UserError(f"{self.where}.{key}: expected true or false, found {value!r}")
        return value
