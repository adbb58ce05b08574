"""What is held during a record: which conditions a system knows, and what they may be."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from numbers import Real

from deabayes.faults import nearest

Conditions = Mapping[str, Mapping[str, float | str | None]]
"""Excitation channel -> condition -> its value where a record states none; None if not known.

A condition is a text where that value is one, and else a number."""

TEXT, BARE = "a text", "a finite number without a unit (the one of its name, else SI)"


def condition_faults(
    system: str, told: Conditions | None, given: Mapping[str, object]
) -> list[str]:
    """What is wrong with conditions; a system that tells none (`told` None) may have any."""
    unstated = {name: held for names in (told or {}).values() for name, held in names.items()}
    if told is None:
        return [fault for name in given for fault in _wrong(name, given[name], (BARE, TEXT))]
    hint = "" if unstated else "; it has none, remove it"
    faults = [
        f"condition {name!r} is unknown for system {system!r}{hint or nearest(name, unstated)}"
        for name in given
        if name not in unstated and name != "protocol"
    ]
    for name in (each for each in given if each in unstated):
        wanted = TEXT if isinstance(unstated[name], str) else BARE
        faults += _wrong(name, given[name], (wanted,))
    return faults


def _wrong(name: str, value: object, wanted: tuple[str, ...]) -> list[str]:
    """What is said of a value that is nothing of what is wanted."""
    if (TEXT in wanted and isinstance(value, str)) or (BARE in wanted and _is_number(value)):
        return []
    return [f"condition {name!r} must be {' or '.join(wanted)}, found {value!r}"]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
