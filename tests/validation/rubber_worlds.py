"""Simulated rubbers in three deformations, like Treloar's: candidates `ogden_n`.

The stretches, and the number of readings of each deformation, are about those of the public
records. Priors are those of somebody who knows soft rubbers; the noise priors are the defaults.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Excitation, Experiment, Specimen
from deabayes.study import Settings
from tests.validation.worlds import World, blank, fifths

LARGEST: dict[str, tuple[float, int]] = {
    "uniaxial": (7.6, 24),
    "equibiaxial": (4.5, 14),
    "pure_shear": (5.0, 14),
}
"""Largest stretch and number of readings."""
SHARE: Settings = {"distribution": "lognormal", "median": "150 kPa", "sigma": 0.7}
"""Of each term's share of the shear modulus, mu_i alpha_i / 2."""
EXPONENT: Settings = {"distribution": "uniform", "lower": -3.0, "upper": 5.0}


def rubber() -> World:
    """Three quasi-static records of one rubber, all fitted."""

    def pulled(deformation: str) -> Experiment:
        largest, count = LARGEST[deformation]
        stretch = np.linspace(1.0, largest, count + 1)[1:]
        held = {"deformation": deformation, "protocol": "quasi_static"}
        return blank(
            deformation, "quasi_static", ("nominal_stress", "Pa"), stretch,
            Excitation("stretch", "1", stretch, stretch, held), coordinate=("stretch", "1"),
        )  # fmt: skip

    return World(
        "ogden",
        Specimen("validation", "tensile_strip", {"kind": "simulated"}, {}),
        lambda terms: {"alpha": EXPONENT} | {f"mu_{i}": SHARE for i in range(1, terms + 1)},
        tuple(map(pulled, LARGEST)),
        smooth_in=fifths,
    )
