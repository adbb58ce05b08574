"""Physical systems by name.

Adding one: a folder `systems/<name>/` with a module `system`, and a line in REGISTRY. The
class derives from `System`. Modules are imported when first asked for, so that a job pays
for its own system only. Systems in a user's own files come in through `own_models`.
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
"""System -> its class, in the module `system` of the folder of the same name."""

OWN: dict[str, type[System]] = {}
"""System of a user's own file -> its class."""


def system_class(system: str) -> type[System]:
    """The class of a system.

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
    """The system `system` at the order `candidate` names, for one specimen.

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
    """Candidates of a system that can be built (examples, where a name has free numbers)."""
    return system_class(system).candidates()


def _has_like(system: str, candidate: str) -> bool:
    """Whether the name begins as one of the system's candidates: `_inertia` may follow."""
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
