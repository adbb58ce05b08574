"""The unit that values given in Python carry: as a quantity, an attribute, or in their name."""

from __future__ import annotations

import re
from typing import Any

from deabayes.faults import UserError
from deabayes.units import DIMENSIONLESS, USUAL_UNITS, same_dimension, to_si

UNIT_OF_NAME = re.compile(r"\[(?P<unit>[^\[\]]*)\]\s*$")
IN_PARENTHESES = re.compile(r"\((?P<unit>[^()]*)\)\s*$")
BETWEEN_WORDS = re.compile(r"[\s_\-/.,:()]+")
COMPOSED = re.compile(r"[*/^]")
SPELT_OUT = 5
"""Letters from which a word that is a unit to pint (`kilovolt`) is taken for one; of shorter words
too many are (`av`, an attovolt)."""


def without_unit(values: Any, expected: str, where: str) -> tuple[Any, str | None]:
    """Values, and the unit that they carry; None if they carry none.

    Raises
    ------
    UserError : values that are called after another unit than `expected`, but not as `name [unit]`.
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
    if name is not None and text != where:
        _refuse_another_unit(text, expected, where)
    return values, None


def _refuse_another_unit(name: str, expected: str, where: str) -> None:
    """Refuse `voltage (kV)`, `voltage_kV`, `kV` and the like: volts, or kilovolts?"""
    within = IN_PARENTHESES.search(name)
    meant = [_unit_meant(within["unit"].strip(), expected, anything=True)] if within else []
    words = [word for word in BETWEEN_WORDS.split(name) if word[:1].isalpha() or word == "%"]
    meant += [_unit_meant(word, expected) for word in words]
    units = (unit for unit in meant if unit and to_si(1.0, unit, expected, where) != 1.0)
    unit = next(units, None)
    if unit is None:
        return
    short = where.rpartition(" ")[2]
    wanted = "plain numbers" if expected == "1" else expected
    raise UserError(
        f"{where}: the values are called {name!r}, which does not tell whether they are in "
        f"{unit}; rename them '{short} [{unit}]' if they are, or {short!r} if they are {wanted}"
    )


def _unit_meant(word: str, expected: str, anything: bool = False) -> str | None:
    """The unit that a word of a name is, if it is one of what is expected.

    Parameters
    ----------
    anything : a usual unit of something else is meant as one, too.
    """
    if word.lower() in DIMENSIONLESS:
        return None
    word = word.replace("\u03bc", "\u00b5")  # two letters that look alike: mu, and micro
    alike = [usual for usual in USUAL_UNITS if usual.lower() == word.lower()]
    usual = [word] if word in alike else alike
    fitting = [each for each in usual if same_dimension(each, expected)]
    if fitting:
        return expected if expected in fitting else fitting[0]
    if anything and (usual or COMPOSED.search(word)) and same_dimension(word, word):
        return word
    if anything or len(word) >= SPELT_OUT:
        return next((s for s in (word, word.lower()) if same_dimension(s, expected)), None)
    return None
