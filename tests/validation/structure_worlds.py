"""Simulated minimum-energy structures: at rest (stage 1) and in motion (stage 2).

At rest, forces at 57 displacements under 0 and 5 kV are fitted, those under 3 kV held out; the
film has `n` Ogden terms. In motion, eight periods of sines of 5 kV at 1, 5 and 10 Hz, 20 points
each, are fitted, and one of 4 kV at 3 Hz is held out; the film has one term and there are `n`
Maxwell units. Priors are those of somebody who knows the paper: wide enough for any film of the
kind, narrow enough that a draw rarely leaves the bent branch; one that does is drawn again.
The noise is that of known instruments, not of the default priors: those allow correlation
lengths below the spacing of the points, where both parts of the noise are one.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Quantity, Role, Specimen
from deabayes.study import Settings
from tests.shared import structures
from tests.validation.worlds import World, blank, fifths

PERIODS, PER_PERIOD, KNOTS = 8, 20, 200
QUANTITIES = {
    **structures.QUANTITIES,
    "window_area": Quantity(1.5e-3, "m^2", 1.5e-5),
    "rest_angle": Quantity(np.pi / 4.0, "rad", 0.0087),
}
SPECIMEN = Specimen(
    "validation", "minimum_energy_structure", {"kind": "simulated"}, QUANTITIES
)  # fmt: skip
FILM: dict[str, Settings] = {
    "film_stress": {"distribution": "lognormal", "median": "1.4 MPa", "sigma": 0.2},
    "alpha": {"distribution": "uniform", "lower": 0.0, "upper": 3.0},
    "relative_permittivity": {"distribution": "lognormal", "median": 1.7, "sigma": 0.15},
}

NOISE: dict[str, Settings] = {
    "quasi_static.sigma_white": {"distribution": "lognormal", "median": "0.2 mN", "sigma": 0.3},
    "quasi_static.sigma_ou": {"distribution": "lognormal", "median": 0.006, "sigma": 0.3},
    "quasi_static.tau_ou": {"distribution": "loguniform", "lower": "1 mm", "upper": "10 mm"},
}
MOVING_NOISE: dict[str, Settings] = {
    "sine.sigma_white": {"distribution": "lognormal", "median": "5 um", "sigma": 0.3},
    "sine.sigma_ou": {"distribution": "lognormal", "median": 0.003, "sigma": 0.3},
    "sine.tau_ou": {"distribution": "loguniform", "lower": "20 ms", "upper": "1 s"},
}
"""Noise of known instruments, and of a model with an error of one per cent."""


def at_rest() -> World:
    """Stage 1: candidates `ogden_n`."""
    displacement = np.linspace(-2e-3, 12e-3, 57)

    def pull(kilovolts: float, role: Role = "calibrate") -> Experiment:
        held = {"voltage": 1e3 * kilovolts, "protocol": "quasi_static"}
        excitation = Excitation("displacement", "m", displacement, displacement, held)
        return blank(
            f"quasi_static_{kilovolts:g}kV", "quasi_static", ("force", "N"), displacement,
            excitation, role, ("displacement", "m"),
        )  # fmt: skip

    return World(
        "ogden",
        SPECIMEN,
        lambda _: FILM | NOISE,
        (pull(0.0), pull(5.0)),
        (pull(3.0, "validate"),),
        smooth_in=fifths,
    )


def in_motion() -> World:
    """Stage 2: candidates `ogden_1_units_n`."""

    def sine(kilovolts: float, frequency: float, role: Role = "calibrate") -> Experiment:
        phase = np.arange(PERIODS * KNOTS + 1) / KNOTS
        middle, half = 500.0 * (kilovolts + 0.5), 500.0 * (kilovolts - 0.5)
        volts = middle - half * np.cos(2.0 * np.pi * phase)
        excitation = Excitation("voltage", "V", phase / frequency, volts)
        name = f"sine_{kilovolts:g}kV_{frequency:g}Hz"
        return blank(name, "sine", ("displacement", "m"), _times(frequency), excitation, role)

    return World(
        "ogden_1_units",
        SPECIMEN,
        motion_priors,
        (sine(5.0, 1.0), sine(5.0, 5.0), sine(5.0, 10.0)),
        (sine(4.0, 3.0, "validate"),),
    )


def motion_priors(units: int) -> dict[str, Settings]:
    """What one expects of the units after the paper.

    A film of one term with an exponent below about 0.8 has no stable rest at 45 degrees: its
    stress falls too slowly as the structure flattens.
    """
    return {
        **FILM,
        **MOVING_NOISE,
        "alpha": {"distribution": "uniform", "lower": 1.0, "upper": 3.0},
        "eta_0": {"distribution": "lognormal", "median": 0.1, "sigma": 0.5},
        "tau": {"distribution": "loguniform", "lower": "5 ms", "upper": "5 s"},
        **{
            f"k_{i}": {"distribution": "lognormal", "median": "15 N/m", "sigma": 0.7}
            for i in range(1, units + 1)
        },
    }


def _times(frequency: float) -> FloatArray:
    return np.asarray((np.arange(PERIODS * PER_PERIOD) + 0.5) / (PER_PERIOD * frequency))
