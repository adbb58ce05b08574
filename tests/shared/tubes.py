"""The stand-in tubular actuator of the golden tables, as this project's objects."""

from __future__ import annotations

import numpy as np
from tests.shared.biased_sines import SineResponse

from deabayes.experiment import Quantity
from deabayes.systems.electrostatics import maxwell_pressure
from deabayes.systems.tubular.base import moving_mass
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.sine import Harmonic
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

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


STAND_INS = {
    "E0_Pa": 1.5e6,
    "Kelvin_elements": {
        "1": {"E_Pa": [12e6], "tau_s": [6e-3]},
        "2": {"E_Pa": [12e6, 6e6], "tau_s": [6e-3, 0.12]},
        "3": {"E_Pa": [12e6, 6e6, 20e6], "tau_s": [6e-3, 0.12, 1.0]},
    },
    "relative_permittivity": 3.1,
    "thickness_m": 80e-6,
    "cross_section_m2": 6e-4,
    "active_length_m": 0.07,
    "active_mass_kg": 0.0462,
    "total_mass_kg": 0.1005,
    "sensor_mass_kg": 0.01,
    "capacitance_F": 180e-9,
    "series_resistance_ohm": 954.0,
    "leakage_resistance_ohm": 1e9,
}
"""What the golden tables were computed with; stated here so that other tests do without them."""


def inertia(load):
    """M [kg/m] under a load [g], (1,)."""
    got = STAND_INS
    masses = (got[f"{name}_mass_kg"] for name in ("total", "active", "sensor"))
    mass = moving_mass(*masses) + 1e-3 * load
    return np.atleast_1d(mass * got["active_length_m"] / got["cross_section_m2"])


def chain(units):
    elements = STAND_INS["Kelvin_elements"][str(units)]
    return Chain(
        np.array([1.0 / STAND_INS["E0_Pa"]]),
        1.0 / np.array([elements["E_Pa"]]),
        np.array([elements["tau_s"]]),
    )


def moving_chain(units, load):
    return MovingChain(chain(units), inertia(load))


def circuit():
    got = STAND_INS
    names = "series_resistance_ohm", "leakage_resistance_ohm", "capacitance_F"
    return Circuit(*(np.array([got[name]]) for name in names))


def pressure_per_square():
    got = STAND_INS
    return np.array([maxwell_pressure(1.0, got["thickness_m"], got["relative_permittivity"])])


def actuator(units, load):
    return SineResponse(circuit(), moving_chain(units, load), pressure_per_square())


def harmonic(tube, bias):
    """The package's harmonic response of a `SineResponse`."""
    return Harmonic(tube.chain, tube.circuit, tube.pressure_per_square, bias)


def transfer(space, rate):
    """C (s - A)^-1 B + D (W, R) of a `StateSpace` at the complex rates s (R,) [1/s]."""
    resolvent = rate[:, None, None] * np.eye(space.b.shape[1]) - space.a[:, None]
    states = np.linalg.solve(resolvent, space.b[:, None, :, None])[..., 0]
    return np.einsum("wn,wrn->wr", space.c, states) + space.d[:, None]
