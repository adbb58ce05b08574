"""Spring laws by name; a new one is a module `springs/<name>.py` and a line here."""

from __future__ import annotations

from deabayes.registry import load
from deabayes.systems.springs.base import (
    DEFORMATIONS,
    PrincipalStretches,
    Spring,
    principal_stretches,
)

CLASSES: dict[str, type[Spring]] = load(
    __name__,
    {
        "gent": "Gent",
        "neo_hookean": "NeoHookean",
        "ogden": "Ogden",
    },
)
"""Spring law -> its class in the module of the same name."""
REGISTRY: dict[str, Spring] = {name: law() for name, law in CLASSES.items()}

__all__ = ["DEFORMATIONS", "REGISTRY", "PrincipalStretches", "Spring", "principal_stretches"]
