"""Read and check specimen.yaml: the tested specimen and its instruments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from numbers import Real
from pathlib import Path
from typing import Any

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import Faults, Report, UserError, nearest
from deabayes.records.columns import CHANNELS
from deabayes.records.marks import confirm, without_marks_in
from deabayes.records.schema import read_yaml, violations
from deabayes.records.text import check_format
from deabayes.systems import system_class
from deabayes.systems.specimen_quantities import PROPERTIES
from deabayes.units import parse_quantity, same_dimension, si_unit, to_si

FILE = "specimen.yaml"
MINIMAL = {"name": "specimen", "provenance": {"kind": "simulated"}}
INSTRUMENT_UNITS = {"delay": "s", "current_limit": "A"}
MAY_BE_ZERO = ("delay", "resolution")
SUPPLY = "current"
"""The channel that a `current_limit` applies to."""


@dataclass(frozen=True)
class SpecimenFile:
    """specimen.yaml as read: the specimen, and how its records are stored.

    Attributes
    ----------
    units : quantity -> the unit it was written in, for display.
    sound : whether the file was read completely; if not, only what checks of records need is
        present.
    guesses : guesses of `deabayes new` that are not confirmed, as faults.
    """

    specimen: Specimen
    record_format: Mapping[str, Any] | None = None
    download: Mapping[str, str] | None = None
    note: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    sound: bool = True
    guesses: Sequence[str] = ()


def stated_quantity(entry: Mapping[str, Any], unit: str | None, where: str) -> Quantity:
    """Return an entry with `value`, `unit` and optional `sd`, in `unit` (None: in SI)."""
    written = str(entry["unit"])
    unit = unit or si_unit(written, where)
    value = float(to_si(entry["value"], written, unit, where))
    sd = None if entry.get("sd") is None else float(to_si(entry["sd"], written, unit, where))
    if sd is not None and not 0.0 < sd < float("inf"):
        raise UserError(f"{where}.sd: must be a positive number, found {entry['sd']}; correct it, "
                        "or leave it out where the value is exact")  # fmt: skip
    return Quantity(value, unit, sd, str(entry.get("source", "")))


def read_instruments(content: Mapping[str, Any], where: str, report: Report) -> dict[str, Quantity]:
    """Read instrument properties by name, or ``channel.name`` for those of one channel.

    Parameters
    ----------
    content : specimen.yaml, valid by its schema.
    where : the file, for messages.
    """
    read = {}
    for key, entry in content.get("instruments", {}).items():
        nested = {key: entry} if key in PROPERTIES else {f"{key}.{n}": e for n, e in entry.items()}
        for name, item in nested.items():
            prop = name.rpartition(".")[2]
            unit = INSTRUMENT_UNITS.get(prop) or (None if key in PROPERTIES else CHANNELS[key])
            place = f"{where}, instruments.{name}"
            with report.catching():
                read[name] = _possible(stated_quantity(item, unit, place), item, prop, place)
                if unit is None:
                    _check_dimension(read[name], item, prop, content["system"], place)
                if key not in PROPERTIES and read[name].value > 0.0:
                    _check_channel(key, prop, content["system"], place)
    return read


def _possible(quantity: Quantity, entry: Mapping[str, Any], prop: str, where: str) -> Quantity:
    """Check that a property is exact, finite and positive; some may also be zero."""
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
    """Check that a property without a channel has the dimension of some channel of the system."""
    responses, excitations = _channels(system)
    units = [*responses.values(), *(excitations.values() if prop == "range" else ())]
    if units and not any(same_dimension(quantity.unit, unit) for unit in units):
        known = ", ".join(dict.fromkeys(units))
        raise UserError(
            f"{where}: {entry['unit']!r} is no unit of what system {system!r} measures ({known}); "
            "correct it, or put it under the channel it belongs to"
        )


def _check_channel(channel: str, prop: str, system: str, where: str) -> None:
    """Check that a delay belongs to a response, and a current limit to the current."""
    if prop == "current_limit" and channel != SUPPLY:
        raise UserError(f"{where}: it is the current that is limited; put it under "
                        f"`{SUPPLY}:`, or under no channel")  # fmt: skip
    # The sensor's delay changes the phase only, not the gain.
    delayed = [name for name in _channels(system)[0] if name != "gain"]
    if prop == "delay" and delayed and channel not in delayed:
        raise UserError(f"{where}: a delay is taken out of what system {system!r} responds with "
                        f"({', '.join(delayed)}), not of its {channel}; put it under one of "
                        "these, or remove it")  # fmt: skip


def _channels(system: str) -> tuple[Mapping[str, str], Mapping[str, str]]:
    """Return responses and excitations of a system; empty if its name is unknown."""
    try:
        kind = system_class(system)
    except UserError:
        return {}, {}
    return kind.responses, kind.excitations


def read_specimen(folder: Path) -> Specimen:
    """Return the specimen of a study folder, in SI units.

    Raises
    ------
    Faults : every fault of specimen.yaml.
    """
    try:
        content = (Path(folder) / FILE).read_bytes()
    except OSError:
        return read_specimen_file(folder).specimen  # raises with the reason
    return _specimen_of(Path(folder), content)


@lru_cache(maxsize=32)
def _specimen_of(folder: Path, content: bytes) -> Specimen:
    """Read the specimen and cache it by `content`: reading costs more than simulating."""
    file = read_specimen_file(folder)
    if file.guesses:
        raise Faults(file.guesses)
    return file.specimen


def read_specimen_file(folder: Path) -> SpecimenFile:
    """Read all of specimen.yaml of a study folder; raises like `read_specimen`.

    Guesses that are not confirmed are no fault here, so that the records can be checked.
    """
    path = Path(folder) / FILE
    content, guesses = read_content(folder)
    content |= {key: {} for key in ("quantities", "instruments") if content.get(key, 0) is None}
    report = Report()
    report.include(violations(content, "specimen", str(path)))
    if report.faults:
        _check_system(content, str(path), report)
    report.raise_faults()
    check_format(content.get("record_format"), report.at(str(path)))
    quantities = _quantities(content, str(path), report)
    instruments = read_instruments(content, str(path), report)
    report.raise_faults()
    provenance = {key: str(value) for key, value in content["provenance"].items()}
    return SpecimenFile(
        Specimen(str(content["name"]), content["system"], provenance, quantities, instruments),
        content.get("record_format"),
        content.get("download"),
        content.get("note", ""),
        {name: str(entry["unit"]) for name, entry in content["quantities"].items()},
        guesses=[f"{path}: {confirm(guesses)}"] if guesses else [],
    )


def read_content(folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return specimen.yaml as it is written but for the marks of guesses, and the guesses."""
    content = read_yaml(Path(folder) / FILE)
    guesses = []
    for key in [k for k in ("system", "record_format") if k in content]:
        content[key], found = without_marks_in(content[key], key)
        guesses += found
    return content, guesses


def specimen_from_quantities(system: str, quantities: Mapping[str, Any]) -> Specimen:
    """Make a specimen from quantities: numbers in SI, texts (``40 µm``) or mappings.

    Raises
    ------
    Faults : unknown system, unknown or missing quantity, wrong unit.
    """
    where = "specimen"
    units = known_quantities(system)
    content: dict[str, Any] = {"system": system, "quantities": {}}
    report = Report()
    for name, given in quantities.items():
        if isinstance(given, Mapping):
            content["quantities"][name] = plain = _plain(given)
            mapping = {**MINIMAL, "system": system, "quantities": {name: plain}}
            report.include(violations(mapping, "specimen", where))
            continue
        unit = units.get(name, "1")
        with report.catching():
            value = parse_quantity(given, unit, f"{where}, {name}")
            content["quantities"][name] = {"value": value, "unit": unit}
    report.raise_faults()
    read = _quantities(content, where, report)
    report.raise_faults()
    return Specimen(where, system, {"kind": "simulated"}, read, {})


def _plain(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Replace numpy numbers in a quantity's mapping by Python numbers."""
    given = {key: value for key, value in entry.items() if value is not None}
    return {
        key: float(value) if isinstance(value, Real) and not isinstance(value, bool) else value
        for key, value in given.items()
    }


def system_named(folder: Path) -> str:
    """Return the system that a folder's specimen.yaml names, unchecked; empty if it names none."""
    try:
        return str(read_content(folder)[0].get("system", ""))
    except (OSError, UserError):
        return ""  # reading the full file reports the fault


def known_quantities(system: str) -> dict[str, str]:
    """Return quantity -> SI unit for all that a system requires or can use."""
    kind = system_class(system)
    return {**kind.required_quantities, **kind.optional_quantities}


def _check_system(content: Mapping[str, Any], where: str, report: Report) -> bool:
    """Report an unknown name of the system, and return whether it is known."""
    if not isinstance(content.get("system"), str):
        return False
    try:
        system_class(content["system"])
    except UserError as error:
        report.fault(f"{where}, system: {error}")
        return False
    return True


def _quantities(content: Mapping[str, Any], where: str, report: Report) -> dict[str, Quantity]:
    """Return all quantities in SI, and report their faults."""
    system, known = content["system"], _check_system(content, where, report)
    units = known_quantities(system) if known else {}
    required = system_class(system).required_quantities if known else {}
    read = {}
    for name, entry in content["quantities"].items():
        place = f"{where}, quantities.{name}"
        if units and name not in units:
            hint = nearest(name, units)
            report.fault(f"{place}: system {system!r} has no such quantity{hint}")
            continue
        with report.catching():
            read[name] = _positive(stated_quantity(entry, units.get(name), place), entry, place)
    for name, unit in required.items():
        if name not in content["quantities"]:
            report.fault(
                f"{where}, quantities: system {system!r} requires {name!r}; add {name}: {{value: "
                f"..., unit: {unit}}}"
            )
    return read


def _positive(quantity: Quantity, entry: Mapping[str, Any], where: str) -> Quantity:
    """Check that a quantity is positive; lengths, areas, masses and resistances are."""
    if not 0.0 < quantity.value < float("inf"):
        raise UserError(f"{where}: must be positive, found {entry['value']} {entry['unit']}")
    return quantity
