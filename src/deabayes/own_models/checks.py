"""Checks of a user's own system: its class, its candidates and its errors."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

from deabayes.experiment import PROTOCOLS, Specimen
from deabayes.faults import UserError, nearest
from deabayes.prior.distributions import Distribution
from deabayes.prior.parameter import Parameter
from deabayes.systems import REGISTRY, System
from deabayes.units import si_unit, to_si

UNITS_OF = {
    "excitations": "{'voltage': 'V'}",
    "responses": "{'displacement': 'm'}",
    "required_quantities": "{'thickness': 'm'}, or {}",
}
"""Attribute that maps names to SI units -> an example."""


def system_faults(kind: type[System]) -> list[str]:
    """Return every fault of a class: name, protocols, missing methods and attributes, units."""
    faults = _name_faults(kind) + _protocol_faults(kind)
    if kind.__abstractmethods__:
        methods = ", ".join(sorted(kind.__abstractmethods__))
        faults.append(f"lacks {methods}; define what deabayes.systems.System requires")
    for attribute, example in UNITS_OF.items():
        value = getattr(kind, attribute, None)
        if not isinstance(value, Mapping):
            found = "none" if value is None else repr(value)
            faults.append(f"{attribute} must map names to SI units, as {example}; found {found}")
        else:
            faults += unit_faults(attribute, value)
    faults += unit_faults("optional_quantities", kind.optional_quantities)
    return [f"class {kind.__name__}: {fault}" for fault in faults]


def _name_faults(kind: type[System]) -> list[str]:
    name = getattr(kind, "name", None)
    if not isinstance(name, str) or not name:
        found = "none" if name is None else repr(name)
        return [f"name must be a text, the one after `system:` in specimen.yaml; found {found}"]
    if name in REGISTRY:
        return [f"name {name!r} is a shipped system's; choose another"]
    return []


def _protocol_faults(kind: type[System]) -> list[str]:
    protocols = getattr(kind, "protocols", None)
    if not isinstance(protocols, tuple | list) or not protocols:
        found = "none" if protocols is None else repr(protocols)
        return [f"protocols must be a tuple such as ('creep',); found {found}"]
    unknown = [name for name in protocols if name not in PROTOCOLS]
    return [f"unknown protocol {name!r}{nearest(str(name), PROTOCOLS)}" for name in unknown]


def unit_faults(attribute: str, units: Mapping[str, Any]) -> list[str]:
    """Faults: units of the named items that are unknown or not SI."""
    faults = []
    for name, unit in units.items():
        try:
            base = si_unit(str(unit), f"{attribute}, {name}")
            if float(to_si(1.0, str(unit), base, name)) != 1.0:
                faults.append(f"{attribute}, {name}: unit {unit!r} is not SI; write {base!r}")
        except UserError as error:
            faults.append(str(error))
    return faults


RESERVED = ("chain", "draw", "ensemble", "time")
"""Names of dimensions in posterior files, in tables of draws, and of responses."""


def candidate_faults(system: System, candidate: str) -> list[str]:
    """Return every fault of a candidate's system, before any response is computed.

    Errors that its methods raise are passed on.
    """
    faults = _attribute_faults(system, candidate)
    found, where = system.parameters(), f"parameters() of {candidate}"
    if not isinstance(found, Sequence) or not all(isinstance(p, Parameter) for p in found):
        return [*faults, f"{where} gives {found!r:.80}; return a tuple of Parameter"]
    if not found:
        return [*faults, f"{where} returns no parameter; return at least one"]
    for parameter in found:
        if not isinstance(parameter.prior, Distribution):
            faults.append(
                f"parameter {parameter.name!r}: the prior is {parameter.prior!r:.80}; give a "
                "distribution, such as LogNormal(1e6, 1.0) of deabayes.prior.distributions"
            )
    channels = (*system.excitations, *system.responses)
    faults += name_faults("parameter", [p.name for p in found], channels)
    return faults + unit_faults("parameter", {str(p.name): p.unit for p in found})


def name_faults(kind: str, names: Sequence[object], taken: Iterable[str] = ()) -> list[str]:
    """Faults: names that are invalid in result files, already taken, or repeated."""
    known = {*RESERVED, *taken}
    faults = []
    for name in dict.fromkeys(names):
        if not isinstance(name, str) or not name.isidentifier():
            faults.append(
                f"{kind} {name!r}: use only letters, digits and underscores, and no digit first "
                "(only names of noise parameters contain a dot)"
            )
        elif name in known:
            faults.append(f"{kind} {name!r}: the name is taken; choose another")
        elif names.count(name) > 1:
            faults.append(f"{kind} {name!r} occurs {names.count(name)} times; use other names")
    return faults


def _attribute_faults(system: System, candidate: str) -> list[str]:
    """Faults: attributes that `__init__` did not set, or set to a wrong value."""
    order, specimen = getattr(system, "order", None), getattr(system, "specimen", None)
    faults = []
    if getattr(system, "candidate", None) != candidate:
        found = _found(system, "candidate")
        faults.append(f"__init__ must set self.candidate to the candidate's name; found {found}")
    if not isinstance(order, Integral):
        found = _found(system, "order")
        faults.append(f"__init__ must set self.order to a whole number; found {found}")
    if not isinstance(specimen, Specimen):
        found = _found(system, "specimen")
        faults.append(f"__init__ must set self.specimen to its argument specimen; found {found}")
    return faults


def _found(system: System, attribute: str) -> str:
    return repr(getattr(system, attribute)) if hasattr(system, attribute) else "none"


PACKAGE = str(Path(__file__).parents[1])
OURS = (RuntimeError, OSError, ImportError, MemoryError, SystemError)
"""Errors that wrong arguments do not cause. Raised in code that a model calls, they are not the
model's fault."""


def fault_of(error: BaseException, path: Path) -> str | None:
    """Say where in a model's file an error arose; None if the model is not at fault.

    Of the model's code and this package's code, the code that ran last decides. If the model
    called the package with wrong arguments, the message says so.
    """
    file = str(path.resolve())
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file or Path(frame.filename).is_relative_to(PACKAGE)
    ]
    own = [frame for frame in frames if frame.filename == file]
    if not own:
        return None
    place = f"{path}, line {own[-1].lineno}"
    if frames[-1].filename == file:
        return f"{place}: {said(error)}; correct the model there"
    if isinstance(error, OURS):
        return None
    called = Path(frames[-1].filename).relative_to(PACKAGE).with_suffix("")
    module = ".".join(("deabayes", *called.parts))
    return f"{place}: {module} raises {said(error)}; correct the arguments of this call"


def said(error: BaseException) -> str:
    """Return the type and message of an error in one line."""
    words = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}: {words}".replace("\n", " ").rstrip(": ")
