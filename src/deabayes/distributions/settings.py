"""Distributions from config entries, with their units checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields

from deabayes.distributions import REGISTRY, Distribution
from deabayes.faults import UserError, nearest
from deabayes.quantities import taken_in_si
from deabayes.units import parse_quantity


def from_settings(settings: Mapping[str, object], unit: str, where: str) -> Distribution:
    """A distribution from a config entry, with its units checked.

    Parameters
    ----------
    settings : ``{"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}``;
        numbers are in SI units, texts carry their unit.
    unit : SI unit of the quantity.
    where : file and key, for the message.

    Raises
    ------
    UserError : unknown distribution or setting, a missing one, a wrong unit, or
        values that make no distribution.
    """
    if not isinstance(settings, Mapping):
        raise UserError(
            f"{where}: expected a mapping such as "
            f"{{distribution: lognormal, median: 1, sigma: 0.5}}, found {settings!r}"
        )
    name = settings.get("distribution")
    if name not in REGISTRY:
        hint = nearest(str(name), REGISTRY)
        raise UserError(f"{where}: unknown distribution {name!r}{hint}")
    kind = REGISTRY[str(name)]
    values = {key: value for key, value in settings.items() if key != "distribution"}
    _check_keys(kind, str(name), values, where)
    numbers = {
        key: _number(value, "1" if key in kind.dimensionless else unit, f"{where}.{key}")
        for key, value in values.items()
    }
    try:
        return kind(**numbers)
    except ValueError as error:
        raise UserError(f"{where}: {error}") from None


def without_units(settings: Mapping[str, object], unit: str, where: str) -> list[str]:
    """What to say of numbers that `from_settings` takes in SI units; nothing where that is 1."""
    kind = REGISTRY.get(str(settings.get("distribution")))
    if kind is None or unit == "1":
        return []
    return [
        taken_in_si(value, unit, f"{where}.{key}")
        for key, value in settings.items()
        if key != "distribution" and key not in kind.dimensionless and _is_plain(value)
    ]


def _is_plain(value: object) -> bool:
    try:
        return not isinstance(value, bool) and bool(float(value))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return False


def _check_keys(
    kind: type[Distribution], name: str, values: Mapping[str, object], where: str
) -> None:
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            raise UserError(f"{where}: {name} has no setting {key!r}{nearest(key, known)}")
    missing = [k for k, f in known.items() if k not in values and f.default is MISSING]
    if missing:
        raise UserError(f"{where}: {name} needs {' and '.join(missing)}; add {missing[0]}")


def _number(value: object, unit: str, where: str) -> float:
    """A number as it is, or a text such as ``35 kPa`` in SI units."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, str):
        raise UserError(f"{where}: expected a number or a text such as '2 {unit}', found {value!r}")
    try:
        return float(value)
    except ValueError:
        return float(parse_quantity(value, unit, where))
