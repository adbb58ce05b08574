"""specimen.yaml of the reference minimum-energy structure: what its experimenter would know."""

from __future__ import annotations

from data.make.writing import quantity

STAND_IN = "stand-in, not in the paper's text"
PAPER = "minimum-energy structure 2019, Table 1"

PROVENANCE = (
    "Simulated by data.make.minimum_energy_structure with scipy's DOP853: the slider and "
    "crank of the paper on minimum-energy structures (Smart Mater. Struct. 2019, Tables 1, 3 and "
    "4), window area and rest angle stand-ins, with a fifth, slow Maxwell unit (300 s) that "
    "candidates with one to four units leave out, dry friction (0.3 mN) beside the viscous one "
    "and an amplifier that follows its command with a lag of 1 ms; read by a laser sensor with "
    "0.5 ms delay, offset, drift, Ornstein-Uhlenbeck and white noise, quantisation and a tilted "
    "head (0.12 mm too much at 12.35 mm, growing with the square). Forces are means of a slow way "
    "out and back (0.02 mm/s) on a stage whose position is exact, read by a load cell with "
    "offset, drift and noise; hysteresis that is not symmetric, up to 7 mN, stays in them."
)


SPECIMEN: dict[str, object] = {
    "name": "minimum_energy_structure",
    "system": "minimum_energy_structure",
    "provenance": {"kind": "simulated", "source": PROVENANCE, "licence": "BSD-3-Clause"},
    "quantities": {
        "link_length": quantity(33.50, "mm", PAPER),
        "mass_centre": quantity(15.78, "mm", PAPER),
        "link_mass": quantity(0.603, "g", PAPER),
        "slider_mass": quantity(0.40, "g", PAPER),
        "rotational_inertia": quantity(156.56, "g*mm^2", PAPER),
        "film_thickness": quantity(
            40, "um", "1 mm of film stretched 5 x 5 (minimum-energy structure 2019); taken as exact"
        ),
        "prestretch": quantity(5, "1", "minimum-energy structure 2019; taken as exact"),
        "window_area": quantity(14.9, "cm^2", STAND_IN + "; 0.67 sd below the truth", 0.15),
        "rest_angle": quantity(45, "deg", STAND_IN, 0.5),
        "hinge_stiffness": quantity(
            0.0258,
            "N*m/rad",
            STAND_IN + "; measured, 0.5 sd above what the equilibrium at rest asks for",
            0.0013,
        ),
    },
    "instruments": {
        "displacement": {
            "delay": {"value": 0.5, "unit": "ms"},
            "range": {"value": 100, "unit": "mm"},
            "resolution": {"value": 3, "unit": "um"},
            "noise": {"value": 3, "unit": "um"},
        },
        "force": {
            "resolution": {"value": 0.01, "unit": "mN"},
            "noise": {"value": 0.14, "unit": "mN"},
        },
        "voltage": {"range": {"value": 10, "unit": "kV"}},
    },
}
