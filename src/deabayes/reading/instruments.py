"""The instruments of specimen.yaml: what each property may be, and under which channel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deabayes.experiment import Quantity
from deabayes.faults import UserError
from deabayes.instruments import PROPERTIES
from deabayes.reading.columns import CHANNELS
from deabayes.reading.entries import stated_quantity
from deabayes.units import same_dimension

INSTRUMENT_UNITS = {"delay": "s", "current_limit": "A"}
MAY_BE_ZERO = ("delay", "resolution")
SUPPLY = "current"
"""The channel that a `current_limit` is of."""


def read_instruments(
    content: Mapping[str, Any], where: str, faults: list[str]
) -> dict[str, Quantity]:
    """Properties by name, those of one channel as ``channel.name``; faults are added to `faults`.

    Parameters
    ----------
    content : specimen.yaml, by its schema.
    where : the file.
    """
    read = {}
    for key, entry in content.get("instruments", {}).items():
        nested = {key: entry} if key in PROPERTIES else {f"{key}.{n}": e for n, e in entry.items()}
        for name, item in nested.items():
            prop = name.rpartition(".")[2]
            unit = INSTRUMENT_UNITS.get(prop) or (None if key in PROPERTIES else CHANNELS[key])
            place = f"{where}, instruments.{name}"
            try:
                read[name] = _possible(stated_quantity(item, unit, place), item, prop, place)
                if unit is None:
                    _check_dimension(read[name], item, prop, content["system"], place)
                if key not in PROPERTIES and read[name].value > 0.0:
                    _check_channel(key, prop, content["system"], place)
            except UserError as error:
                faults.append(str(error))
    return read


def _possible(quantity: Quantity, entry: Mapping[str, Any], prop: str, where: str) -> Quantity:
    """An instrument's property as it can be: exact, finite, and positive or, for some, zero."""
    if quantity.sd is not None:
        other = ", or state a tube's as quantities.sensor_delay" if prop == "delay" else ""
        raise UserError(f"{where}: instruments are taken for exact, found sd {entry['sd']:g}; "
                        f"remove it{other}")  # fmt: skip
    zero = prop in MAY_BE_ZERO and quantity.value == 0.0
    if not zero and not 0.0 < quantity.value < float("inf"):
        wanted = "zero or positive" if prop in MAY_BE_ZERO else "positive"
        raise UserError(f"{where}: must be {wanted}, found {entry['value']} {entry['unit']}; "
                        "correct it, or leave it out where it is not known")  # fmt: skip
    return quantity


def _check_dimension(
    quantity: Quantity, entry: Mapping[str, Any], prop: str, system: str, where: str
) -> None:
    """A property under no channel is of a dimension that some channel of the system has."""
    responses, excitations = _channels(system)
    units = [*responses.values(), *(excitations.values() if prop == "range" else ())]
    if units and not any(same_dimension(quantity.unit, unit) for unit in units):
        known = ", ".join(dict.fromkeys(units))
        raise UserError(
            f"{where}: {entry['unit']!r} is no unit of what system {system!r} measures ({known}); "
            "correct it, or put it under the channel it belongs to"
        )


def _check_channel(channel: str, prop: str, system: str, where: str) -> None:
    """A delay is that of a response, a limit of the current that of the current."""
    if prop == "current_limit" and channel != SUPPLY:
        raise UserError(f"{where}: it is the current that is limited; put it under "
                        f"`{SUPPLY}:`, or under no channel")  # fmt: skip
    # What the sensor behind a gain lags by is in the phase alone.
    delayed = [name for name in _channels(system)[0] if name != "gain"]
    if prop == "delay" and delayed and channel not in delayed:
        raise UserError(f"{where}: a delay is taken out of what system {system!r} responds with "
                        f"({', '.join(delayed)}), not of its {channel}; put it under one of "
                        "these, or remove it")  # fmt: skip


def _channels(system: str) -> tuple[Mapping[str, str], Mapping[str, str]]:
    """Responses and excitations of a system; none where its name is at fault, said elsewhere."""
    from deabayes.systems import system_class

    try:
        kind = system_class(system)
    except UserError:
        return {}, {}
    return kind.responses, kind.excitations
