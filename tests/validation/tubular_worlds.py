"""The tubular actuator of the recovery and order checks: a creep record, or the whole model.

The whole model (mass and circuit) has a creep record and frequency responses under 100 and
500 g, gain and phase each; held out are creep at 2.5 kV and the response under 300 g.
"""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Excitation, Experiment, Quantity, Role, Specimen
from deabayes.study import Settings
from tests.validation.worlds import World, blank


def tubular() -> World:
    """A creep record of 0.5 s at 2 kV, as in `calibration`: the cheap family."""
    quantities = {
        "thickness": Quantity(80e-6, "m", 2e-6),
        "relative_permittivity": Quantity(3.1, "1", 0.1),
        "active_length": Quantity(0.07, "m"),
    }
    excitation = Excitation("voltage", "V", np.array([0.0, 1e-9, 0.5]), np.array([0, 2e3, 2e3]))
    time = np.geomspace(1e-3, 0.5, 120)
    return World(
        "voigt_kelvin",
        Specimen("validation", "tubular", {"kind": "simulated"}, quantities),
        tubular_priors,
        (blank("creep", "creep", ("strain", "1"), time, excitation),),
    )


def tubular_priors(units: int) -> dict[str, Settings]:
    """What one knows of a silicone before the test."""
    return {
        "E_0": {"distribution": "lognormal", "median": "1.5 MPa", "sigma": 0.3},
        "tau": {"distribution": "loguniform", "lower": "2 ms", "upper": "1 s"},
        **{
            f"E_{i}": {"distribution": "lognormal", "median": "10 MPa", "sigma": 0.5}
            for i in range(1, units + 1)
        },
    }


def tubular_full() -> World:
    """The whole tubular actuator: creep and frequency responses under two loads."""
    quantities = {
        "thickness": Quantity(80e-6, "m", 2e-6),
        "relative_permittivity": Quantity(3.1, "1", 0.1),
        "active_length": Quantity(0.07, "m"),
        "cross_section": Quantity(6e-4, "m^2", 0.15e-4),
        "total_mass": Quantity(0.1005, "kg"),
        "active_mass": Quantity(0.0462, "kg", 1e-3),
        "sensor_mass": Quantity(0.01, "kg", 5e-4),
        "series_resistance": Quantity(954.0, "ohm", 50.0),
        "leakage_resistance": Quantity(1e9, "ohm", 0.2e9),
        "capacitance": Quantity(180e-9, "F", 2e-9),
    }
    time, frequency = np.arange(2e-3, 0.5, 2e-3), np.arange(1.0, 100.5, 1.0)

    def creep(kilovolts: float, role: Role = "calibrate") -> Experiment:
        """Raised within 3 ms, as a current of 120 mA does it."""
        volts = 1e3 * kilovolts * np.array([0.0, 1.0, 1.0])
        excitation = Excitation("voltage", "V", np.array([0.0, 3e-3, 0.5]), volts)
        return blank(f"creep_{kilovolts:g}kV", "creep", ("strain", "1"), time, excitation, role)

    def shaken(load: float, role: Role = "calibrate") -> tuple[Experiment, Experiment]:
        held = {"load_g": load, "bias_kV": 2.0}
        excitation = Excitation("frequency", "Hz", frequency, frequency, held)
        name, protocol, along = f"shaken_{load:g}g", "frequency_response", ("frequency", "Hz")
        return (
            blank(name, protocol, ("gain", "1/V"), frequency, excitation, role, along),
            blank(f"{name}_phase", protocol, ("phase", "rad"), frequency, excitation, role, along),
        )

    return World(
        "voigt_kelvin",
        Specimen("validation", "tubular", {"kind": "simulated"}, quantities),
        tubular_priors,
        (creep(2.0), *shaken(100.0), *shaken(500.0)),
        (creep(2.5, "validate"), *shaken(300.0, "validate")),
        ending="_inertia_circuit",
    )
