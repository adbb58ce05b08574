"""Looking up an instrument's property for one channel of a record."""

from __future__ import annotations

from deabayes.experiment import Quantity, Specimen
from deabayes.units import same_dimension

OF_AMPLIFIER = ("voltage", "current")
"""Channels that the amplifier's own monitors show."""
PROPERTIES = ("delay", "range", "resolution", "noise", "current_limit")


def instrument(
    specimen: Specimen, name: str, channel: str, unit: str | None = None
) -> Quantity | None:
    """The property `name` (`delay`, `range`, ...) of the instrument at `channel`.

    A property under the channel's own mapping (`force: {noise: ...}`, kept as
    ``force.noise``) comes first; then the one given for the specimen at large, if
    `unit` is None or its dimension is that of `unit`. A `delay` for the specimen at large is that
    of what senses its motion or force: the amplifier's monitors do not have it, and no dimension
    would tell.
    """
    own = specimen.instruments.get(f"{channel}.{name}")
    if own is not None:
        return own
    if name == "delay" and channel in OF_AMPLIFIER:
        return None
    general = specimen.instruments.get(name)
    if general is None or (unit is not None and not same_dimension(general.unit, unit)):
        return None
    return general
