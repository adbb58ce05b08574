"""Spring laws by name. To add a law, write a module `springs/<name>.py` and add it here."""

from __future__ import annotations

from deabayes.systems.springs.base import (
    DEFORMATIONS,
    PrincipalStretches,
    Spring,
    principal_stretches,
)
from deabayes.systems.springs.gent import Gent
from deabayes.systems.springs.neo_hookean import NeoHookean
from deabayes.systems.springs.ogden import Ogden

REGISTRY: dict[str, Spring] = {
    law.name: law()
    for law in (
        Gent,
        NeoHookean,
        Ogden,
    )
}
"""Name of a spring law -> the law."""

__all__ = ["DEFORMATIONS", "REGISTRY", "PrincipalStretches", "Spring", "principal_stretches"]
