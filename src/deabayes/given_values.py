"""Values that are given in Python, as floats in SI units."""

from __future__ import annotations

from deabayes.experiment import FloatArray

import datetime
import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deabayes.carried_unit import without_unit
from deabayes.faults import UserError
from deabayes.units import parse_quantity, to_si


COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+\s*")


def array_in_si(values: ArrayLike, unit: str, where: str) -> FloatArray:
    """Values as floats in the SI unit `unit`: numbers, texts with a unit, spans of time.

    A unit that numbers carry counts: a pint quantity's, `units` of a DataArray, that in the name of
    a pandas Series (`voltage [kV]`). Others are in SI, and may not be called otherwise.

    Raises
    ------
    UserError : dates, anything else that is no number, masked values, texts without unit, a
        carried unit of another dimension, a name that tells of another unit.
    """
    if callable(values) and not hasattr(values, "__array__"):
        raise UserError(f"{where}: expected numbers in {unit}, found a function; give its values")
    if isinstance(values, list | tuple) and any(hasattr(each, "magnitude") for each in values):
        return np.asarray([array_in_si(each, unit, where) for each in values])
    values, carried = without_unit(values, unit, where)
    _refuse_masked(values, where)
    try:
        array = np.asarray(values)
    except ValueError:
        raise UserError(f"{where}: rows of unlike length; give one array of numbers") from None
    first = array.flat[0] if array.size else None
    if array.dtype.kind == "M" or isinstance(first, datetime.date | np.datetime64):
        raise UserError(
            f"{where}: expected numbers in {unit}, found dates ({first}); give what has passed "
            "since the first, as `t - t[0]`"
        )
    if array.dtype.kind == "m" or isinstance(first, datetime.timedelta):
        if unit != "s":
            raise UserError(f"{where}: expected numbers in {unit}, found spans of time ({first})")
        return np.asarray(array.astype("timedelta64[ns]") / np.timedelta64(1, "s"), dtype=float)
    if isinstance(first, str):
        comma = next((each for each in array.flat if COMMA_NUMBER.fullmatch(str(each))), None)
        if comma is not None:
            raise UserError(f"{where}: found texts with a decimal comma ({comma!r}); give numbers "
                            "(pandas reads such files with decimal=',')")  # fmt: skip
        parsed = [parse_quantity(str(each), unit, where) for each in array.flat]
        return np.asarray(parsed, dtype=float).reshape(array.shape)
    if array.dtype.kind not in "fiubO":
        raise UserError(f"{where}: expected numbers in {unit}, found {first!r}")
    try:
        numbers = array.astype(float)
    except (TypeError, ValueError):
        raise UserError(f"{where}: expected numbers in {unit}, found {values!r:.60}") from None
    return numbers if carried is None else to_si(numbers, carried, unit, where)


def _refuse_masked(values: Any, where: str) -> None:
    """numpy hands on what lies under a mask as if it were known."""
    rows = values if isinstance(values, list | tuple) else (values,)
    masked = sum(np.ma.count_masked(row) for row in rows if np.ma.isMaskedArray(row))
    if masked:
        raise UserError(f"{where}: {masked} values are masked; leave out what is not known")
