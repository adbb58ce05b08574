"""Convert units: users may write any unit that pint knows; the package works in SI.

SI here means m, s, N, Pa, V, A, F, ohm, kg, K, Hz, rad and 1 (strain, stretch, ratio).
An angle is not a plain number and an angular frequency is not a frequency: `deg`
where `1` is expected, or `rad/s` where `Hz` is expected, is a wrong dimension.
"""

from __future__ import annotations

import re
from functools import cache
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.faults import UserError

DIMENSIONLESS = frozenset({"", "1", "-", "none", "dimensionless"})
USUAL_UNITS = (
    *("m", "cm", "mm", "um", "µm", "nm", "m^2", "cm^2", "mm^2", "m^3", "mm^3"),
    *("s", "ms", "us", "min", "hour", "Hz", "kHz", "mHz", "1/s"),
    *("N", "mN", "kN", "Pa", "kPa", "MPa", "GPa", "N/m", "N*m", "N*s/m", "Pa*s", "N/mm^2"),
    *("V", "mV", "kV", "A", "mA", "uA", "µA", "F", "pF", "nF", "uF", "ohm", "kohm", "Mohm", "Gohm"),
    *("kg", "g", "mg", "kg/m^3", "g/cm^3", "kg*m^2", "g*mm^2", "F/m", "K", "degC"),
    *("rad", "deg", "%", "%/V", "1/V", "mm/min", "mm/s", "1"),
)
PREFERRED_UNITS = (
    *("1", "rad", "m", "s", "kg", "A", "K", "N", "Pa", "V", "F", "ohm", "Hz", "rad/s"),
    *("m^2", "m^3", "m/s", "m/s^2", "N/m", "Pa*s", "N*s/m", "N*m", "1/V", "kg/m^3", "F/m", "C"),
)
MEANINGS = {
    "1": "a plain number",
    "rad": "an angle",
    "m": "a length",
    "m^2": "an area",
    "s": "a time",
    "kg": "a mass",
    "A": "a current",
    "N": "a force",
    "Pa": "a stress",
    "V": "a voltage",
    "F": "a capacitance",
    "ohm": "a resistance",
    "Hz": "a frequency",
    "rad/s": "an angular frequency",
    "K": "a temperature",
}
NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")
POWER = re.compile(r"(?<=[A-Za-zµ])([23])(?![A-Za-z0-9])")
"""A power as it is written without a sign: N/m2."""
WITH_FACTOR = re.compile(r"\s*([+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?)?)\s*\*?\s*([A-Za-zµμΩ°%].*?)\s*")
"""A number, or a sign, before a unit: a monitor's `2 kV`, a position `-mm` counted downwards."""
DECIMAL_COMMA = re.compile(r",\d")
"""Begin of the text behind a whole number that was meant as a decimal fraction."""


@cache
def registry() -> Any:
    """The process's one pint registry; made on first use."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def to_si(
    values: ArrayLike, unit: str, expected_unit: str | None = None, where: str = ""
) -> FloatArray:
    """Convert values in `unit` to the SI unit `expected_unit`.

    Parameters
    ----------
    values : any shape.
    unit : anything pint reads; ``%`` and empty (a plain number) too.
    expected_unit : SI unit of the result; None takes `si_unit(unit)`.
    where : file and column or key, for the message.

    Raises
    ------
    UserError : unknown unit, or a unit of another dimension.
    """
    expected_unit = si_unit(unit, where) if expected_unit is None else expected_unit
    _check_dimension(unit, expected_unit, where)
    scaled = _factor(unit) * np.asarray(values, dtype=float)
    quantity = registry().Quantity(scaled, _parse(unit, where))
    return np.asarray(quantity.m_as(_parse(expected_unit, where)), dtype=float)


def parse_quantity(text: str | float, expected_unit: str, where: str) -> float:
    """A number in SI units from a text such as ``35 kPa``; a bare number is in SI already.

    Raises
    ------
    UserError : no number, no unit where one is needed, unknown unit, wrong dimension.
    """
    if isinstance(text, Real) and not isinstance(text, bool):
        return float(text)
    match = NUMBER_AND_UNIT.match(text) if isinstance(text, str) else None
    if match is None:
        raise UserError(
            f"{where}: expected a number and a unit such as '2 {expected_unit}', found {text!r}"
        )
    number, unit = match.groups()
    if DECIMAL_COMMA.match(unit):
        point = f"{number}.{unit[1:]}"
        raise UserError(f"{where}: {text!r} has a decimal comma; write a point, as in {point!r}")
    if not unit and expected_unit != "1":
        raise UserError(f"{where}: {text!r} has no unit; write '{number} {expected_unit}'")
    if unit[:1].isdigit() or unit[:1] in ("+", "-"):
        raise UserError(f"{where}: {text!r} has two numbers; write one and its unit")
    return float(to_si(float(number), unit, expected_unit, where))


def si_unit(unit: str, where: str = "") -> str:
    """The SI unit that values in `unit` are converted to: ``kV`` -> ``V``, ``%`` -> ``1``."""
    base = _base(unit, where)
    for preferred in PREFERRED_UNITS:
        if _base(preferred, "") == base:
            return preferred
    return f"{base:~C}"


def same_dimension(unit: str, other: str) -> bool:
    """Whether values in `unit` can be converted to `other`; False for unknown units."""
    try:
        _check_dimension(unit, other, "")
    except UserError:
        return False
    return True


def _check_dimension(unit: str, expected_unit: str, where: str) -> None:
    if unit == expected_unit and unit in PREFERRED_UNITS:  # pint takes most of a second to load
        return
    given, expected = _base(unit, where), _base(expected_unit, where)
    if given == expected:
        return
    angles_matter = expected in (_base("1", ""), _base("rad", ""), _base("Hz", ""))
    if given.dimensionality == expected.dimensionality and not angles_matter:
        return
    raise UserError(
        f"{where}: unit {unit or '1'!r} is {_meaning(unit)}, expected {_meaning(expected_unit)} "
        f"(such as {expected_unit!r}); correct the unit or the column it belongs to"
    )


def _meaning(unit: str) -> str:
    return MEANINGS.get(si_unit(unit), f"in {si_unit(unit)}")


@cache
def _base(unit: str, where: str) -> Any:
    """Base units of `unit`, a pint Unit; radian kept apart from dimensionless."""
    return registry().get_base_units(_parse(unit, where))[1]


@cache
def _parse(unit: str, where: str) -> Any:
    """The pint Unit written in `unit`.

    Pint's parser raises errors of many types, which all mean an unknown unit. Its pixel is that of
    web pages, 1/96 inch, and is refused.
    """
    match = WITH_FACTOR.fullmatch(unit)
    text = match[2] if match else unit.strip()
    if text.lower() in DIMENSIONLESS:
        return registry().dimensionless
    parsed = _parsed(text) or _parsed(POWER.sub(r"^\1", text))
    if "pixel" in f"{text} {parsed}".lower():
        raise UserError(f"{where}: unit {unit!r}: a pixel has no size; give values in mm")
    if parsed is None:
        raise UserError(f"{where}: unknown unit {unit!r}{_nearest_unit(text)}")
    return parsed


def _factor(unit: str) -> float:
    """The number before a unit: 2 of `2 kV`, -1 of `-mm`."""
    match = WITH_FACTOR.fullmatch(unit)
    if match is None or match[1] in ("", "+"):
        return 1.0
    return -1.0 if match[1] == "-" else float(match[1])


def _parsed(text: str) -> Any:
    try:
        return registry().parse_units(text)
    except Exception:
        return None


def _nearest_unit(text: str) -> str:
    """Suggest the same unit in other letters (`kpa`, `Newton`), but no merely similar unit."""
    meant = [usual for usual in USUAL_UNITS if usual.lower() == text.lower()]
    small = _parsed(text.lower())
    meant += [] if small is None else [f"{small:~C}"]
    if meant:
        return f"; did you mean {meant[0]!r}?"
    return "; write it as pint does, such as 'kV' or 'mm^2'"
