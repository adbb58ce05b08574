"""What is wrong with a candidate of a user's own system, once built: its attributes, its names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Integral

from deabayes.distributions import Distribution
from deabayes.experiment import Specimen
from deabayes.own_models.class_checks import unit_faults
from deabayes.parameter import Parameter
from deabayes.systems import System

RESERVED = ("chain", "draw", "ensemble", "time")
"""What draws are numbered by, in posterior files and in tables of them, and responses by."""


def candidate_faults(system: System, candidate: str) -> list[str]:
    """Every fault of the system that was built for a candidate, before it is asked for responses.

    What its methods raise is raised as it comes.
    """
    faults = _attribute_faults(system, candidate)
    found, where = system.parameters(), f"parameters() of {candidate}"
    if not isinstance(found, Sequence) or not all(isinstance(p, Parameter) for p in found):
        return [*faults, f"{where} gives {found!r:.80}; return a tuple of Parameter"]
    if not found:
        return [*faults, f"{where} gives none; there is nothing to fit"]
    for parameter in found:
        if not isinstance(parameter.prior, Distribution):
            faults.append(
                f"parameter {parameter.name!r}: the prior is {parameter.prior!r:.80}; give a "
                "distribution, such as LogNormal(1e6, 1.0) of deabayes.distributions"
            )
    channels = (*system.excitations, *system.responses)
    faults += name_faults("parameter", [p.name for p in found], channels)
    return faults + unit_faults("parameter", {str(p.name): p.unit for p in found})


def name_faults(kind: str, names: Sequence[object], taken: Iterable[str] = ()) -> list[str]:
    """Names that files of results cannot have, that something else has, or that come twice."""
    known = {*RESERVED, *taken}
    faults = []
    for name in dict.fromkeys(names):
        if not isinstance(name, str) or not name.isidentifier():
            faults.append(
                f"{kind} {name!r}: a name is of letters, digits and underscores and begins with "
                "no digit (noise parameters have the dot)"
            )
        elif name in known:
            faults.append(f"{kind} {name!r}: the name is taken; choose another")
        elif names.count(name) > 1:
            faults.append(f"{kind} {name!r} is there {names.count(name)} times; give each a name")
    return faults


def _attribute_faults(system: System, candidate: str) -> list[str]:
    """What `__init__` has to set, and did not, or to something else."""
    order, specimen = getattr(system, "order", None), getattr(system, "specimen", None)
    faults = []
    if getattr(system, "candidate", None) != candidate:
        found = _found(system, "candidate")
        faults.append(f"__init__ sets self.candidate to the candidate's name; found {found}")
    if not isinstance(order, Integral):
        found = _found(system, "order")
        faults.append(f"__init__ sets self.order to a whole number; found {found}")
    if not isinstance(specimen, Specimen):
        found = _found(system, "specimen")
        faults.append(f"__init__ sets self.specimen to the specimen it is given; found {found}")
    return faults


def _found(system: System, attribute: str) -> str:
    return repr(getattr(system, attribute)) if hasattr(system, attribute) else "none"
