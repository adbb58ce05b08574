"""Spring laws by name. To add a law, write a module `springs/<name>.py` and add a line here."""

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
"""Spring law -> its class, in the module with the name of the law."""
REGISTRY: dict[str, Spring] = {name: law() for name, law in CLASSES.items()}

__all__ = ["DEFORMATIONS", "REGISTRY", "PrincipalStretches", "Spring", "principal_stretches"]
