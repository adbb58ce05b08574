"""Minimum-energy structures, their draws and their excitations, for tests."""

from __future__ import annotations

import dataclasses

import numpy as np

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.systems.minimum_energy_structure.system import MinimumEnergyStructure

QUANTITIES = {
    "link_length": Quantity(0.0335, "m"),
    "mass_centre": Quantity(0.01578, "m"),
    "link_mass": Quantity(6.03e-4, "kg"),
    "slider_mass": Quantity(4e-4, "kg"),
    "rotational_inertia": Quantity(1.5656e-7, "kg*m^2"),
    "film_thickness": Quantity(4e-5, "m"),
    "prestretch": Quantity(5.0, "1"),
    "window_area": Quantity(1.5e-3, "m^2"),
    "rest_angle": Quantity(np.pi / 4.0, "rad"),
}
"""The paper's Table 1 and the stand-ins of the golden tables."""
PLAIN = Specimen("plain", "minimum_energy_structure", {}, QUANTITIES)
FILM = {
    "mu_1": 73.98e3, "mu_2": 634.06e3, "mu_3": 127.92e3, "mu_4": 3.45e3,
    "alpha_1": 0.243, "alpha_2": 0.331, "alpha_3": 0.744, "alpha_4": 3.306,
    "relative_permittivity": 1.704,
}  # fmt: skip
"""The paper's Table 3, exponents ascending."""
STIFFNESS, VISCOSITY = (66.0, 8.0, 3.5, 0.8), (0.55, 4.0, 20.0, 50.0)
"""The paper's Table 4."""
LENGTH, REST = 0.067, np.pi / 4
"""Length of two links [m] and the angle at no voltage [rad]."""


def specimen(**changes):
    return dataclasses.replace(PLAIN, quantities={**QUANTITIES, **changes})


def structure(candidate="ogden_4_units_4", tolerance=1e-6, specimen=PLAIN):
    return MinimumEnergyStructure(candidate, specimen, tolerance)


def paper_draws(units=4, count=1, **changes):
    values = FILM | {"eta_0": 0.1}
    for i in range(units):
        values |= {f"k_{i + 1}": STIFFNESS[i], f"tau_{i + 1}": VISCOSITY[i] / STIFFNESS[i]}
    return {name: np.full(count, float(value)) for name, value in (values | changes).items()}


def spread_draws(units=4, count=64, sd=0.1, seed=1):
    rng = np.random.default_rng(seed)
    draws = paper_draws(units, count)
    return {
        name: value if name.startswith("alpha") else value * np.exp(sd * rng.standard_normal(count))
        for name, value in draws.items()
    }


def voltage(time, volts, **conditions):
    return Excitation("voltage", "V", np.array(time, float), np.array(volts, float), conditions)


def sine(frequency, periods=10, amplitude=5.0, per_period=1000):
    """The paper's (1): from 0.5 kV to `amplitude` [kV]."""
    phase = np.arange(periods * per_period + 1) / per_period
    middle, half = 0.5 * (amplitude + 0.5), 0.5 * (amplitude - 0.5)
    return voltage(phase / frequency, 1e3 * (middle - half * np.cos(2.0 * np.pi * phase)))


def pull(displacement, volts):
    return Excitation("displacement", "m", displacement, displacement, {"voltage": volts})
