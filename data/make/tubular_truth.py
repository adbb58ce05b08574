"""The simulated tubular actuator as it is: its material, masses and circuit, its instruments."""

from __future__ import annotations

from dataclasses import dataclass

from data.make.sensor import Sensor

from deabayes.experiment import FloatArray
from deabayes.systems.electrostatics import maxwell_pressure

MONITOR_NOISE = 0.3
"""sd of the amplifier's voltage monitor [V]."""


@dataclass(frozen=True)
class Truth:
    """The simulated actuator and its amplifier, SI.

    Masses, cross-section and circuit differ from what specimen.yaml states by up to its sd.
    Beside the capacitance lie branches of a resistance and a capacitance in series, the
    dielectric's absorption, given by `absorbing` capacitances and their times.
    """

    E: tuple[float, ...] = (1.5e6, 12e6, 6e6, 25e6)
    tau: tuple[float, ...] = (6e-3, 0.12, 1.5)
    thickness: float = 80e-6
    relative_permittivity: float = 3.1
    active_length: float = 0.07
    cross_section: float = 6.08e-4
    total_mass: float = 0.1005
    active_mass: float = 0.0469
    sensor_mass: float = 0.0103
    capacitance: float = 181.2e-9
    series_resistance: float = 1010.0
    leakage_resistance: float = 1.1e9
    absorbing: tuple[float, ...] = (4e-9, 6e-9)
    absorption_time: tuple[float, ...] = (4.0, 25.0)
    current_limit: float = 0.12

    def inertia(self, load: float) -> float:
        """M [kg/m] of Sarban et al. (2012), (13), under a load [kg]."""
        moving = self.active_mass + 0.5 * (self.total_mass - self.active_mass)
        return (moving + self.sensor_mass + load) * self.active_length / self.cross_section

    def pressure(self, voltage: FloatArray | float) -> FloatArray:
        """The Maxwell pressure [Pa] of a voltage [V] on the capacitance."""
        return maxwell_pressure(voltage, self.thickness, self.relative_permittivity)

    def branches(self) -> list[tuple[float, float]]:
        """Resistance [ohm] and time [s] of every branch that absorbs charge."""
        given = zip(self.absorbing, self.absorption_time, strict=True)
        return [(time / capacitance, time) for capacitance, time in given]


TRUTH = Truth()
DISPLACEMENT = Sensor(
    delay=4e-4,
    sigma_white=1e-6,
    sigma_ou=1e-6,
    tau_ou=0.01,
    offset=2e-5,
    drift=2e-6,
    resolution=2e-7,
)
"""The LVDT [m]."""
CURRENT = Sensor(
    delay=0.0,
    sigma_white=2e-5,
    sigma_ou=1e-5,
    tau_ou=0.01,
    offset=5e-6,
    drift=0.0,
    resolution=5e-6,
)
"""The amplifier's current monitor [A]."""
LEAKAGE = Sensor(
    delay=0.0,
    sigma_white=1e-8,
    sigma_ou=5e-9,
    tau_ou=2.0,
    offset=5e-10,
    drift=0.0,
    resolution=5e-9,
)
"""The meter of small currents [A]."""
