"""Physical systems by name.

To add a system, write a folder `systems/<name>/` with a module `system`, and add a line to
REGISTRY. The class derives from `System`. A module is imported at its first use, so that a job
loads only its own system. `own_models` loads systems from a user's own files.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from deabayes.experiment import Specimen
from deabayes.faults import UserError, nearest
from deabayes.systems.base import Derived, Draws, Simulator, System, UnknownCandidate

REGISTRY: dict[str, str] = {
    "membrane": "Membrane",
    "minimum_energy_structure": "MinimumEnergyStructure",
    "tensile_strip": "TensileStrip",
    "tubular": "Tubular",
}
"""System -> name of its class, in the module `system` of the folder with the system's name."""

OWN: dict[str, type[System]] = {}
"""System from a user's own file -> its class."""


def system_class(system: str) -> type[System]:
    """Return the class of a system.

    Raises
    ------
    UserError
        If no system has this name.
    """
    if system in OWN:
        return OWN[system]
    if system not in REGISTRY:
        raise UserError(
            f"unknown system {system!r}{nearest(system, [*REGISTRY, *OWN])} (a system of your own: "
            "name the file that defines it under `models` in config.yaml)"
        )
    found: type[System] = getattr(import_module(f"{__name__}.{system}.system"), REGISTRY[system])
    return found


def build(system: str, candidate: str, specimen: Specimen) -> System:
    """Build the system `system` for one specimen, at the order that `candidate` gives.

    Raises
    ------
    UserError
        If the system or the candidate is unknown, or the specimen lacks a quantity.
    """
    try:
        return system_class(system).of(candidate, specimen)
    except UnknownCandidate:
        others = [each for each in REGISTRY if _has_like(each, candidate)]
        if not others or _has_like(system, candidate):
            raise
        raise UserError(
            f"candidate {candidate!r} belongs to system {' or '.join(map(repr, others))}, and the "
            f"specimen's is {system!r}, with {', '.join(candidates(system)[:3])}, ...; correct "
            "`candidates`, or `system` in specimen.yaml"
        ) from None


def candidates(system: str) -> Sequence[str]:
    """Return the candidates of a system, or examples if a name contains a number to choose."""
    return system_class(system).candidates()


def _has_like(system: str, candidate: str) -> bool:
    """Whether the name starts with a candidate of the system; an ending like `_inertia` is fine."""
    return any(candidate.startswith(each) for each in candidates(system))


__all__ = [
    "OWN",
    "REGISTRY",
    "Derived",
    "Draws",
    "Simulator",
    "System",
    "build",
    "candidates",
    "system_class",
]
