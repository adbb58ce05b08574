"""Check values and excitations given in Python, and convert them to SI units."""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deabayes.experiment import Excitation, FloatArray
from deabayes.faults import UserError, nearest
from deabayes.systems.base import System
from deabayes.units import DIMENSIONLESS, USUAL_UNITS, parse_quantity, same_dimension, to_si

UNIT_OF_NAME = re.compile(r"\[(?P<unit>[^\[\]]*)\]\s*$")
IN_PARENTHESES = re.compile(r"\((?P<unit>[^()]*)\)\s*$")
BETWEEN_WORDS = re.compile(r"[\s_\-/.,:()]+")
COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+\s*")
COMPOSED = re.compile(r"[*/^]")
SPELT_OUT = 5
"""Shortest word that counts as a unit because pint knows it (`kilovolt`). Pint takes too many
shorter words for units (`av`, an attovolt)."""


def without_unit(values: Any, expected: str, where: str) -> tuple[Any, str | None]:
    """Return the values and the unit that they carry; None if they carry none.

    Raises
    ------
    UserError : the name of the values contains a unit other than `expected`, but not as
        `name [unit]`.
    """
    if hasattr(values, "magnitude") and hasattr(values, "units"):
        return values.magnitude, str(values.units)
    units = getattr(values, "attrs", {}).get("units")
    if units is not None:
        return values, str(units)
    name = getattr(values, "name", None)
    text = " ".join(map(str, name)) if isinstance(name, tuple) else str(name)
    if header := UNIT_OF_NAME.search(text):
        return values, header["unit"]
    if name is not None and text != where.rpartition(" ")[2]:
        _refuse_another_unit(text, expected, where)
    return values, None


def _refuse_another_unit(name: str, expected: str, where: str) -> None:
    """Refuse ambiguous names such as `voltage (kV)`, `voltage_kV` or `kV`: volts or kilovolts?"""
    within = IN_PARENTHESES.search(name)
    units = [_unit_meant(within["unit"].strip(), expected, anything=True)] if within else []
    words = [word for word in BETWEEN_WORDS.split(name) if word[:1].isalpha() or word == "%"]
    units += [_unit_meant(word, expected) for word in words]
    unit = next((u for u in units if u and to_si(1.0, u, expected, where) != 1.0), None)
    if unit is None:
        return
    short = where.rpartition(" ")[2]
    wanted = "plain numbers" if expected == "1" else expected
    raise UserError(
        f"{where}: the values are called {name!r}, so they may be in {unit}; rename them "
        f"'{short} [{unit}]' if they are, or {short!r} if they are {wanted}"
    )


def _unit_meant(word: str, expected: str, anything: bool = False) -> str | None:
    """Return the unit that a word of a name means, if its dimension is that of `expected`.

    Parameters
    ----------
    anything : a usual unit of another dimension counts too.
    """
    if word.lower() in DIMENSIONLESS:
        return None
    word = word.replace("\u03bc", "\u00b5")  # the letters mu and micro look alike
    alike = [unit for unit in USUAL_UNITS if unit.lower() == word.lower()]
    usual = [word] if word in alike else alike
    fitting = [unit for unit in usual if same_dimension(unit, expected)]
    if fitting:
        return expected if expected in fitting else fitting[0]
    if anything and (usual or COMPOSED.search(word)) and same_dimension(word, word):
        return word
    if anything or len(word) >= SPELT_OUT:
        return next((s for s in (word, word.lower()) if same_dimension(s, expected)), None)
    return None


def array_in_si(values: ArrayLike, unit: str, where: str) -> FloatArray:
    """Convert numbers, texts with a unit or time spans to floats in the SI unit `unit`.

    Numbers may carry a unit: a pint quantity, `units` of a DataArray, or the name of a pandas
    Series (`voltage [kV]`). Other numbers are taken as SI, and their name must not contain
    another unit.

    Raises
    ------
    UserError : dates or other values that are not numbers, masked values, texts without a unit,
        a carried unit of another dimension, a name that contains another unit.
    """
    if callable(values) and not hasattr(values, "__array__"):
        raise UserError(f"{where}: expected numbers in {unit}, found a function; give its values")
    if isinstance(values, list | tuple) and any(hasattr(value, "magnitude") for value in values):
        return np.asarray([array_in_si(value, unit, where) for value in values])
    values, carried = without_unit(values, unit, where)
    _refuse_masked(values, where)
    try:
        array = np.asarray(values)
    except ValueError:
        raise UserError(f"{where}: rows of unlike length; give one array of numbers") from None
    first = array.flat[0] if array.size else None
    if array.dtype.kind == "M" or isinstance(first, datetime.date | np.datetime64):
        raise UserError(
            f"{where}: expected numbers in {unit}, found dates ({first}); give the time since the "
            "first, such as `t - t[0]`"
        )
    if array.dtype.kind == "m" or isinstance(first, datetime.timedelta):
        if unit != "s":
            raise UserError(f"{where}: expected numbers in {unit}, found spans of time ({first})")
        return np.asarray(array.astype("timedelta64[ns]") / np.timedelta64(1, "s"), dtype=float)
    if isinstance(first, str):
        return _texts_in_si(array, unit, where)
    if array.dtype.kind not in "fiubO":
        raise UserError(f"{where}: expected numbers in {unit}, found {first!r}")
    try:
        numbers = array.astype(float)
    except (TypeError, ValueError):
        raise UserError(f"{where}: expected numbers in {unit}, found {values!r:.60}") from None
    return numbers if carried is None else to_si(numbers, carried, unit, where)


def _texts_in_si(texts: NDArray[Any], unit: str, where: str) -> FloatArray:
    """Convert texts with a unit, such as ``"1.8 kV"``; refuse decimal commas."""
    comma = next((text for text in texts.flat if COMMA_NUMBER.fullmatch(str(text))), None)
    if comma is not None:
        raise UserError(
            f"{where}: found texts with a decimal comma ({comma!r}); give numbers (pandas reads "
            "such files with decimal=',')"
        )
    numbers = [parse_quantity(str(text), unit, where) for text in texts.flat]
    return np.asarray(numbers, dtype=float).reshape(texts.shape)


def _refuse_masked(values: Any, where: str) -> None:
    """Refuse masked values, since numpy would use the numbers under the mask."""
    rows = values if isinstance(values, list | tuple) else (values,)
    masked = sum(np.ma.count_masked(row) for row in rows if np.ma.isMaskedArray(row))
    if masked:
        raise UserError(f"{where}: {masked} values are masked; leave out these values")


def excitation_of(
    system: System,
    time: ArrayLike | None,
    channels: Mapping[str, ArrayLike],
    conditions: Mapping[str, float | str],
) -> tuple[Excitation, str]:
    """Return the excitation and the name of its coordinate: `time`, or the channel without time.

    A single value (not an array of one value) is held over the time.

    Raises
    ------
    UserError
        No channel, several channels or an unknown one; `time` missing although the channel needs
        it, or given although the channel has none; values that are not finite numbers; a
        coordinate that does not ascend or is empty; a frequency that is not positive; unknown
        conditions.
    """
    if not isinstance(conditions, Mapping):
        raise UserError(
            f"conditions: give names with values, such as {{'load_g': 300}}; found {conditions!r}"
        )
    system.check_conditions(conditions)
    known = system.excitations
    for name in channels:
        if name not in known:
            raise UserError(
                f"excitation {name!r} is unknown for system {system.name!r}{nearest(name, known)}"
            )
    if len(channels) != 1:
        found = " and ".join(channels) or "none"
        raise UserError(f"give exactly one excitation of {', '.join(known)}; found {found}")
    name, given = next(iter(channels.items()))
    if time is None and name in system.in_time:
        raise UserError(f"{name} drives system {system.name!r} in time; give time= [s] as well")
    if time is not None and name in system.without_time:
        raise UserError(
            f"{name} moves system {system.name!r} through steady states, without time; leave time "
            f"out and give ascending values of {name}"
        )
    values = _finite(given, known[name], name)
    label = name if time is None else "time"
    coordinate = np.atleast_1d(values if time is None else _finite(time, "s", "time"))
    values = np.full(coordinate.shape, values) if values.ndim == 0 else values
    if coordinate.ndim != 1 or coordinate.shape != values.shape:
        raise UserError(f"{label} {coordinate.shape} and {name} {values.shape} differ in length")
    _check_coordinate(coordinate, label)
    driven = Excitation(name, known[name], coordinate, values, conditions, time is not None)
    return driven, label


def _check_coordinate(coordinate: FloatArray, label: str) -> None:
    if coordinate.size == 0:
        raise UserError(f"{label} holds no values; give one at least")
    back = np.flatnonzero(np.diff(coordinate) <= 0.0)
    if back.size:
        raise UserError(f"{label} must ascend; it does not at index {back[0] + 1}")
    if label == "frequency" and coordinate[0] <= 0.0:
        raise UserError(f"frequency must be positive, found {coordinate[0]:g} Hz at index 0")


def _finite(given: ArrayLike, unit: str, name: str) -> FloatArray:
    values = array_in_si(given, unit, name)
    bad = np.argwhere(~np.isfinite(np.atleast_1d(values)))
    if bad.size:
        where = ", ".join(map(str, bad[0]))
        found = np.atleast_1d(values)[tuple(bad[0])]
        raise UserError(f"{name} must be finite, found {found} at index {where}")
    return values
