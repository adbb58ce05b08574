r"""The tubular actuator's material: a linear elastic solid that relaxes.

The chain's creep compliance D(t) is taken for that of uniaxial stress, and the bulk modulus
K = E_0/(3 (1 - 2 nu)) for constant. As 1/E* = 1/(3 G*) + 1/(9 K), the shear compliance is that
of a chain too, with the same times:

1/G*(s) = 2 (1 + nu)/E_0 + sum_n (3/E_n)/(1 + tau_n s).
"""

from __future__ import annotations

import numpy as np

from deabayes.systems.solid import LINEAR, Note, Solid
from deabayes.systems.voigt_kelvin import Chain

POISSON_RATIO = 0.495
NOTES = (
    "Linear, for strains below 5 %: the chain's creep compliance is taken for that of uniaxial "
    "stress. It is one-dimensional, strain along the tube by electrostatic pressure, so its moduli "
    "are effective ones of this tube with its electrodes",
    f"Poisson's ratio {POISSON_RATIO:g} is not from the records, which do not show it: silicone "
    "hardly changes its volume, and 0.495 (bulk modulus 33 times E_0) is as near to 0.5 as usual "
    "elements bear; elements with a pressure of their own take 0.4999 too. The bulk modulus does "
    "not relax",
    "The Prony series is the exact interconversion of the creep compliance: as many terms as "
    "Kelvin units, with shorter times than these have",
)
OTHERS = {
    "inertia": "Masses of the actuator and its load are no part of the material, and left out",
    "circuit": "Resistances and capacitance of the circuit are no part of the material",
}


def solid(chain: Chain, inertia: bool, circuit: bool) -> Solid:
    """The solid of every draw of a chain."""
    free = np.full_like(chain.instantaneous, POISSON_RATIO)
    shear = Chain(
        2.0 * (1.0 + POISSON_RATIO) * chain.instantaneous,
        3.0 * chain.compliances,
        chain.time_constants,
    )
    shares, times = shear.relaxation()
    also = [text for given, text in zip((inertia, circuit), OTHERS.values(), strict=True) if given]
    return Solid(
        LINEAR,
        {"E": 1.0 / chain.instantaneous},
        {"nu": free},
        True,
        shares,
        times,
        notes=tuple(Note(text) for text in (*NOTES, *also)),
    )
