"""specimen.yaml: what was tested, checked against what its system needs to know."""

from __future__ import annotations

from deabayes.systems import system_class

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import Faults, UserError, nearest
from deabayes.reading.entries import stated_quantity
from deabayes.reading.instruments import read_instruments
from deabayes.reading.schema import violations
from deabayes.reading.text import format_faults
from deabayes.reading.yaml_file import read_yaml
from deabayes.units import parse_quantity

if TYPE_CHECKING:
    from deabayes.systems.base import System

FILE = "specimen.yaml"
MINIMAL = {"name": "specimen", "provenance": {"kind": "simulated"}}


@dataclass(frozen=True)
class SpecimenFile:
    """specimen.yaml as read: the specimen, and how its records are stored."""

    specimen: Specimen
    record_format: Mapping[str, Any] | None = None
    download: Mapping[str, str] | None = None
    note: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    """Quantity -> unit it was written in, for display."""
    sound: bool = True
    """Whether all of it was read; else only what is needed to look for faults in records."""


def read_specimen(folder: Path) -> Specimen:
    """The specimen of a study folder, in SI units.

    Raises
    ------
    Faults : every fault of specimen.yaml.
    """
    try:
        content = (Path(folder) / FILE).read_bytes()
    except OSError:
        return read_specimen_file(folder).specimen  # which says what is wrong
    return _specimen_of(Path(folder), content)


@lru_cache(maxsize=32)
def _specimen_of(folder: Path, content: bytes) -> Specimen:
    """Of a folder whose specimen.yaml holds `content`: reading it costs more than simulating."""
    return read_specimen_file(folder).specimen


def read_specimen_file(folder: Path) -> SpecimenFile:
    """specimen.yaml of a study folder with everything in it; raises as `read_specimen`."""
    path = Path(folder) / FILE
    content = read_yaml(path)
    content |= {key: {} for key in ("quantities", "instruments") if content.get(key, 0) is None}
    faults = violations(content, "specimen", str(path))
    if faults:
        raise Faults(faults + _system_faults(content, str(path)))
    faults = format_faults(content.get("record_format"), str(path))
    quantities = _quantities(content, str(path), faults)
    instruments = read_instruments(content, str(path), faults)
    if faults:
        raise Faults(faults)
    provenance = {key: str(value) for key, value in content["provenance"].items()}
    return SpecimenFile(
        Specimen(str(content["name"]), content["system"], provenance, quantities, instruments),
        content.get("record_format"),
        content.get("download"),
        content.get("note", ""),
        {name: str(entry["unit"]) for name, entry in content["quantities"].items()},
    )


def specimen_from_quantities(system: str, quantities: Mapping[str, Any]) -> Specimen:
    """A specimen from a mapping of quantities: numbers in SI, texts (``40 µm``) or mappings.

    Raises
    ------
    Faults : unknown system, unknown or missing quantity, wrong unit.
    """
    where = "specimen"
    units = known_quantities(system)
    content: dict[str, Any] = {"system": system, "quantities": {}}
    faults: list[str] = []
    for name, given in quantities.items():
        if isinstance(given, Mapping):
            content["quantities"][name] = plain = _plain(given)
            mapping = {**MINIMAL, "system": system, "quantities": {name: plain}}
            faults += violations(mapping, "specimen", where)
            continue
        unit = units.get(name, "1")
        try:
            value = parse_quantity(given, unit, f"{where}, {name}")
            content["quantities"][name] = {"value": value, "unit": unit}
        except UserError as error:
            faults.append(str(error))
    if faults:
        raise Faults(faults)
    read = _quantities(content, where, faults)
    if faults:
        raise Faults(faults)
    return Specimen(where, system, {"kind": "simulated"}, read, {})


def _plain(entry: Mapping[str, Any]) -> dict[str, Any]:
    """A quantity's mapping with Python's own numbers in place of numpy's."""
    given = {key: value for key, value in entry.items() if value is not None}
    return {
        key: float(value) if isinstance(value, Real) and not isinstance(value, bool) else value
        for key, value in given.items()
    }


def system_named(folder: Path) -> str:
    """The system that a folder's specimen.yaml names, unchecked; empty where it names none."""
    try:
        return str(read_yaml(Path(folder) / FILE).get("system", ""))
    except (OSError, UserError):
        return ""  # whoever reads the file in earnest says what is wrong


def known_quantities(system: str) -> dict[str, str]:
    """Quantity -> SI unit of all that a system requires or can use."""
    kind = system_class(system)
    return {**kind.required_quantities, **kind.optional_quantities}


def _system_faults(content: Mapping[str, Any], where: str) -> list[str]:
    """What is wrong with the system's name, where the rest is too broken to go on."""
    if not isinstance(content.get("system"), str):
        return []
    try:
        system_class(content["system"])
    except UserError as error:
        return [f"{where}, system: {error}"]
    return []


def _quantities(content: Mapping[str, Any], where: str, faults: list[str]) -> dict[str, Quantity]:
    """All quantities in SI; what is wrong with them is added to `faults`."""
    faults += (wrong := _system_faults(content, where))
    units = {} if wrong else known_quantities(content["system"])
    required = {} if wrong else system_class(content["system"]).required_quantities
    read = {}
    for name, entry in content["quantities"].items():
        place = f"{where}, quantities.{name}"
        if units and name not in units:
            faults.append(f"{place}: system {content['system']!r} has no such quantity"
                          f"{nearest(name, units)}")  # fmt: skip
            continue
        try:
            read[name] = _positive(stated_quantity(entry, units.get(name), place), entry, place)
        except UserError as error:
            faults.append(str(error))
    for name, unit in required.items():
        if name not in content["quantities"]:
            example = f"{name}: {{value: ..., unit: {unit}}}"
            faults.append(
                f"{where}, quantities: system {content['system']!r} requires {name!r}; "
                f"add {example}"
            )
    return read


def _positive(quantity: Quantity, entry: Mapping[str, Any], where: str) -> Quantity:
    """Lengths, areas, masses, resistances and the like are positive."""
    if not 0.0 < quantity.value < float("inf"):
        raise UserError(f"{where}: must be positive, found {entry['value']} {entry['unit']}")
    return quantity
