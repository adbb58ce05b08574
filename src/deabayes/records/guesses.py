"""Guess which columns of a file hold which channels, from names that laboratories use."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from deabayes.records.columns import UNKNOWN_UNIT, Column, is_unit
from deabayes.units import USUAL_UNITS, same_dimension

USUAL_NAMES: Mapping[str, Sequence[str]] = {
    "time": ("t", "zeit", "x_value", "timestamp", "elapsed"),
    "voltage": ("u", "v", "spannung", "hv", "monitor", "volt"),
    "control_voltage": ("command", "setpoint", "sollwert", "u_soll"),
    "current": ("i", "strom"),
    "displacement": (
        *("x", "d", "s", "u", "weg", "dehnweg", "extension", "elongation", "stroke"),
        *("position", "crosshead", "laser", "verschiebung", "travel", "traverse"),
    ),
    "force": ("f", "kraft", "load", "last", "standardkraft"),
    "strain": ("dehnung", "eps", "epsilon"),
    "stretch": ("lambda", "streckung"),
    "nominal_stress": ("stress", "sigma", "p", "nennspannung", "spannung", "zugspannung"),
    "area": ("a", "fläche", "flaeche"),
    "frequency": ("f", "freq", "frequenz"),
    "gain": ("amplitude", "magnitude", "betrag"),
    "phase": ("phi", "phasenlage"),
}
"""Channel -> names of it in files, lower case, apart from its own."""
STRAIN = "strain"
UNIT_BEHIND = re.compile(r"^(?P<name>.*?)\s*(?:[,/_]|\bin\b)\s*(?P<unit>\S+)$")
"""A unit behind a name without brackets: `Force / N`, `Weg in mm`, `displacement_mm`."""
WORD = re.compile(r"[^\W\d_]+(?:_[^\W\d_]+)*")


def likely_columns(columns: Sequence[Column], wanted: Mapping[str, str]) -> dict[str, Column]:
    """Return the likely column of each wanted channel, in the order of `wanted`.

    A channel's own name comes before a usual name of it, and that before a unit that no other
    column has. Units that contradict the channel are no obstacle only for its own name.

    Parameters
    ----------
    wanted : channel -> its SI unit.
    """
    free = [with_unit_behind(c) for c in columns if c.name not in (None, "-")]
    found: dict[str, Column] = {}
    for fits in (_is_named, _is_called, _has_its_unit):
        for channel, unit in wanted.items():
            likely = [c for c in free if channel not in found and fits(c, channel, unit)]
            if likely and (fits is not _has_its_unit or len(likely) == 1):
                free.remove(likely[0])
                found[channel] = _as_channel(likely[0], channel)
    return {channel: found[channel] for channel in wanted if channel in found}


def with_unit_behind(column: Column) -> Column:
    """Return the column with a unit that stands behind its name, if it has no other."""
    match = UNIT_BEHIND.match(column.name or "") if column.unit is None else None
    if match is None or not match["name"] or match["unit"].strip("[]()") not in USUAL_UNITS:
        return column
    return replace(
        column, name=match["name"], unit=match["unit"].strip("[]()"), source=source_of(column)
    )


def source_of(column: Column) -> str:
    """Return the name of a column in its file."""
    return column.source or column.name or ""


def text_of(columns: Iterable[Column]) -> str:
    """Return columns as a cell of experiments.csv: ``Zeit = time [s]; voltage [kV]``."""
    return "; ".join(
        f"{source_of(column)} = {_as_read(column)}" if has_other_name(column) else _as_read(column)
        for column in columns
    )


def has_other_name(column: Column) -> bool:
    """Whether a column is called otherwise, or in another unit, than it is read."""
    return source_of(column) not in (column.name, _as_read(column))


def _as_read(column: Column) -> str:
    name = f"{column.name} - 1" if column.offset else column.name or ""
    return name if column.unit is None else f"{name} [{column.unit}]"


def _as_channel(column: Column, channel: str) -> Column:
    unit = UNKNOWN_UNIT if column.unit is None or not is_unit(column.unit) else column.unit
    strain = channel == "stretch" and any(
        w in (STRAIN, *USUAL_NAMES[STRAIN]) for w in _words(column)
    )
    return Column(channel, unit, 1.0 if strain else column.offset, source_of(column))


def _words(column: Column) -> list[str]:
    return WORD.findall((column.name or "").lower())


def _is_named(column: Column, channel: str, unit: str) -> bool:
    return "_".join((column.name or "").lower().split()) == channel


def _is_called(column: Column, channel: str, unit: str) -> bool:
    """Whether a column has a usual name of a channel among its words, and no other kind of unit."""
    if column.unit is not None and is_unit(column.unit) and not same_dimension(column.unit, unit):
        return False
    usual = (channel, *USUAL_NAMES.get(channel, ()))
    words = _words(column)
    if channel == "stretch":  # a strain is a stretch less one
        usual = (*usual, STRAIN, *USUAL_NAMES[STRAIN])
    return any(word in usual for word in words)


def _has_its_unit(column: Column, channel: str, unit: str) -> bool:
    return unit != "1" and column.unit is not None and same_dimension(column.unit, unit)
