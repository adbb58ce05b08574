"""Spring laws by name. Adding one: a file here and a line in REGISTRY."""

from deabayes.springs.base import DEFORMATIONS, PrincipalStretches, Spring, principal_stretches
from deabayes.springs.gent import Gent
from deabayes.springs.neo_hookean import NeoHookean
from deabayes.springs.ogden import Ogden

REGISTRY: dict[str, Spring] = {law.name: law for law in (Gent(), NeoHookean(), Ogden())}

__all__ = ["DEFORMATIONS", "REGISTRY", "PrincipalStretches", "Spring", "principal_stretches"]
