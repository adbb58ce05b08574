"""What is wrong with a class that is to be a system, before anything is asked of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deabayes.experiment import PROTOCOLS
from deabayes.faults import UserError, nearest
from deabayes.systems import REGISTRY, System
from deabayes.units import si_unit, to_si

UNITS_OF = {
    "excitations": "{'voltage': 'V'}",
    "responses": "{'displacement': 'm'}",
    "required_quantities": "{'thickness': 'm'}, or {}",
}
"""Attribute that maps names to SI units -> an example."""


def system_faults(kind: type[System]) -> list[str]:
    """Every fault of a class: its name, the methods and the attributes it lacks, its units."""
    faults = _name_faults(kind) + _protocol_faults(kind)
    if kind.__abstractmethods__:
        methods = ", ".join(sorted(kind.__abstractmethods__))
        faults.append(f"lacks {methods}; add what deabayes.systems.System asks for")
    for attribute, example in UNITS_OF.items():
        value = getattr(kind, attribute, None)
        if not isinstance(value, Mapping):
            found = "none" if value is None else repr(value)
            faults.append(f"{attribute} maps names to SI units, such as {example}; found {found}")
        else:
            faults += unit_faults(attribute, value)
    faults += unit_faults("optional_quantities", kind.optional_quantities)
    return [f"class {kind.__name__}: {fault}" for fault in faults]


def _name_faults(kind: type[System]) -> list[str]:
    name = getattr(kind, "name", None)
    if not isinstance(name, str) or not name:
        found = "none" if name is None else repr(name)
        return [f"name is what `system:` in specimen.yaml says, a text; found {found}"]
    if name in REGISTRY:
        return [f"name {name!r} is a shipped system's; choose another"]
    return []


def _protocol_faults(kind: type[System]) -> list[str]:
    protocols = getattr(kind, "protocols", None)
    if not isinstance(protocols, tuple | list) or not protocols:
        found = "none" if protocols is None else repr(protocols)
        return [f"protocols is a tuple such as ('creep',); found {found}"]
    unknown = [name for name in protocols if name not in PROTOCOLS]
    return [f"unknown protocol {name!r}{nearest(str(name), PROTOCOLS)}" for name in unknown]


def unit_faults(attribute: str, units: Mapping[str, Any]) -> list[str]:
    """Units, of what bears these names, that are unknown or not SI."""
    faults = []
    for name, unit in units.items():
        try:
            base = si_unit(str(unit), f"{attribute}, {name}")
            if float(to_si(1.0, str(unit), base, name)) != 1.0:
                faults.append(f"{attribute}, {name}: unit {unit!r} is not SI; write {base!r}")
        except UserError as error:
            faults.append(str(error))
    return faults
