"""Simulated tensile strips: rubbers in three deformations, and strips that relax."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Role, Specimen
from deabayes.study import Settings
from tests.validation.worlds import World, blank, fifths

SPECIMEN = Specimen("validation", "tensile_strip", {"kind": "simulated"}, {})
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
    """Three quasi-static records of one rubber like Treloar's, all fitted: candidates `ogden_n`.

    The stretches, and the number of readings of each deformation, are about those of the public
    records. Priors are those of somebody who knows soft rubbers; the noise priors are the defaults.
    """

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
        SPECIMEN,
        lambda terms: {"alpha": EXPONENT} | {f"mu_{i}": SHARE for i in range(1, terms + 1)},
        tuple(map(pulled, LARGEST)),
        smooth_in=fifths,
    )


def strip() -> World:
    """A relaxation at stretch 2 with default priors: candidates `kv_gm_n`.

    Held out are a relaxation at stretch 1.5, and loading to 1.8 and unloading within 80 s.
    """
    ramp = np.concatenate([np.linspace(0.2, 4.0, 20), 4.0 + np.geomspace(0.1, 596, 100)])
    cycle = np.linspace(0.5, 80.0, 160)

    def pulled(
        name: str, protocol: str, at: FloatArray, turns: list[float], stretches: list[float],
        role: Role = "calibrate",
    ) -> Experiment:  # fmt: skip
        excitation = Excitation("stretch", "1", np.array(turns), np.array(stretches))
        return blank(name, protocol, ("nominal_stress", "Pa"), at, excitation, role)

    return World(
        "kv_gm",
        SPECIMEN,
        lambda units: {},
        (pulled("relaxation", "relaxation", ramp, [0.0, 4.0, 600.0], [1.0, 2.0, 2.0]),),
        (
            pulled("relaxation_1.5", "relaxation", ramp, [0.0, 4.0, 600.0], [1.0, 1.5, 1.5],
                   "validate"),
            pulled("load_unload", "load_unload", cycle, [0.0, 40.0, 80.0], [1.0, 1.8, 1.0],
                   "validate"),
        ),
    )  # fmt: skip
