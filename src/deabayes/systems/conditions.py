"""What is held during a record: which conditions a system knows, and what they may be."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from numbers import Real

from deabayes.faults import nearest

Conditions = Mapping[str, Mapping[str, float | str | None]]
"""Excitation channel -> condition -> its value where a record states none; None if not known.

A condition is a text where that value is one, and else a number."""


def condition_faults(
    system: str, told: Conditions | None, given: Mapping[str, object]
) -> list[str]:
    """What is wrong with conditions; of a system that tells none (`told` None), any name is."""
    unstated = {name: held for names in (told or {}).values() for name, held in names.items()}
    if told is None:
        unstated = dict.fromkeys(given)
    hint = "" if unstated else "; it has none, remove it"
    faults = [
        f"condition {name!r} is unknown for system {system!r}{hint or nearest(name, unstated)}"
        for name in given
        if name not in unstated and name != "protocol"
    ]
    for name in (each for each in given if each in unstated):
        as_text = told is None or isinstance(unstated[name], str)
        as_number = told is None or not as_text
        faults += _wrong(name, given[name], as_text, as_number)
    return faults


def _wrong(name: str, value: object, as_text: bool, as_number: bool) -> list[str]:
    """What is said of a value that is neither a text nor a finite number where one may be."""
    number = isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
    if (as_number and number) or (as_text and isinstance(value, str)):
        return []
    bare = "a finite number without a unit (the one of its name, else SI)"
    wanted = " or ".join([bare] * as_number + ["a text"] * as_text)
    return [f"condition {name!r} must be {wanted}, found {value!r}"]
