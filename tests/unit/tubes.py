"""The stand-in tubular actuator of the golden tables, as this project's objects."""

from __future__ import annotations

import numpy as np
from tests.unit.golden import load_golden

from deabayes.electrostatics import maxwell_pressure
from deabayes.experiment import Quantity
from deabayes.systems.circuit import Circuit
from deabayes.systems.inertial_parameter import inertial_parameter
from deabayes.systems.tubular_sine import SineResponse
from deabayes.systems.voigt_kelvin import Chain
from deabayes.systems.voigt_kelvin_inertia import MovingChain

QUANTITIES = {
    "thickness": Quantity(80e-6, "m"),
    "relative_permittivity": Quantity(3.1, "1"),
    "active_length": Quantity(0.07, "m"),
    "cross_section": Quantity(6e-4, "m^2"),
    "total_mass": Quantity(0.1005, "kg"),
    "active_mass": Quantity(0.0462, "kg"),
    "sensor_mass": Quantity(0.01, "kg"),
}
"""Of a tube that moves, without its circuit."""


def golden_inputs():
    return load_golden("tubular_frf")["inputs"]


def inertia(load):
    """M [kg/m] under a load [g], (1,)."""
    got = golden_inputs()
    return np.atleast_1d(
        inertial_parameter(
            got["total_mass_kg"], got["active_mass_kg"], got["sensor_mass_kg"], 1e-3 * load,
            got["active_length_m"], got["cross_section_m2"],
        )
    )  # fmt: skip


def chain(units):
    elements = golden_inputs()["Kelvin_elements"][str(units)]
    return Chain(
        np.array([1.0 / golden_inputs()["E0_Pa"]]),
        1.0 / np.array([elements["E_Pa"]]),
        np.array([elements["tau_s"]]),
    )


def moving_chain(units, load):
    return MovingChain(chain(units), inertia(load))


def circuit():
    got = golden_inputs()
    names = "series_resistance_ohm", "leakage_resistance_ohm", "capacitance_F"
    return Circuit(*(np.array([got[name]]) for name in names))


def pressure_per_square():
    got = golden_inputs()
    return np.array([maxwell_pressure(1.0, got["thickness_m"], got["relative_permittivity"])])


def actuator(units, load):
    return SineResponse(circuit(), moving_chain(units, load), pressure_per_square())
