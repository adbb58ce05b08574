"""Base of all tubular actuator candidates: channels, quantities, moving mass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import Excitation, Experiment, FloatArray, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Conditions, Draws, Simulator, System, cached
from deabayes.systems.curves import drive_of
from deabayes.systems.electrostatics import maxwell_pressure
from deabayes.systems.specimen_quantities import instrument, uncertain_quantities
from deabayes.systems.tubular.circuit import Circuit, Supply

SOURCE = "from total_mass, active_mass and sensor_mass"


def moving_mass(total: ArrayLike, active: ArrayLike, sensor: ArrayLike) -> FloatArray:
    """Compute m_DE + m_LVDT [kg] of (13), the moving mass without a load.

    The active part of the actuator and half of its remaining mass move:
    m_DE = m_active + (m_total - m_active) / 2.
    """
    total, active, sensor = (np.asarray(given, dtype=float) for given in (total, active, sensor))
    return np.asarray(active + 0.5 * (total - active) + sensor)


def moving_quantity(total: Quantity, active: Quantity, sensor: Quantity) -> Quantity:
    """Compute the moving mass of stated masses and its sd; sd is None if no mass has an sd."""
    parts = ((total, 0.5), (active, 0.5), (sensor, 1.0))
    value = float(moving_mass(total.value, active.value, sensor.value))
    if all(mass.sd is None for mass, _ in parts):
        return Quantity(value, "kg", None, SOURCE)
    sd = math.sqrt(sum((weight * (mass.sd or 0.0)) ** 2 for mass, weight in parts))
    return Quantity(value, "kg", sd, SOURCE)


KILOVOLT, GRAM = 1e3, 1e-3
QUANTITY_SYMBOLS = {
    "relative_permittivity": (r"\varepsilon_r", "relative permittivity of the elastomer"),
    "thickness": ("d", "thickness of the elastomer between two electrodes"),
    "active_length": ("L_0", "length between the passive ends, at rest"),
    "sensor_delay": (r"T_\mathrm{s}", "time by which the sensor of the motion lags"),
}
"""Quantities that all candidates with strain use."""
MASSES = ("total_mass", "active_mass", "sensor_mass")
"""`moving_mass` replaces them by their sum (13), because records cannot separate them."""
INERTIA_SYMBOLS = {
    "moving_mass": (r"m_\mathrm{DE}+m_\mathrm{LVDT}", "mass that moves without a load"),
    "cross_section": ("A_0", "cross-section of all elastomer that carries the load"),
}
"""Quantities that `_inertia` adds. It needs the masses, the cross-section and the active length."""
CIRCUIT_SYMBOLS = {
    "series_resistance": ("R_S", "resistance of electrodes and leads"),
    "leakage_resistance": ("R_L", "resistance through the elastomer"),
    "capacitance": ("C", "capacitance at rest"),
}
"""Quantities that a circuit adds and needs."""
MEANINGS = {
    "strain": "elongation of the active length over itself",
    "displacement": "elongation of the active length",
    "gain": "amplitude of the strain over that of the voltage, at the frequency of the voltage",
    "phase": "of the measured strain, the sensor's lag included, to the voltage's sine",
    "total_mass": "mass of the whole actuator",
    "active_mass": "mass of its active part",
    "sensor_mass": "mass of what moves with its end, without the load",
    **{
        name: meaning
        for name, (_, meaning) in (QUANTITY_SYMBOLS | INERTIA_SYMBOLS | CIRCUIT_SYMBOLS).items()
    },
}


class TubularBase(System):
    """A candidate for the tubular actuator: a model of its strain, its current, or both."""

    name: ClassVar[str] = "tubular"
    protocols: ClassVar[tuple[str, ...]] = ("creep", "step", "sine", "sweep", "frequency_response")
    excitations: ClassVar[Mapping[str, str]] = {"voltage": "V", "frequency": "Hz"}
    in_time: ClassVar[tuple[str, ...]] = ("voltage",)
    without_time = ("frequency",)
    even = ("voltage",)
    conditions: ClassVar[Conditions] = {
        "voltage": {"load_g": 0.0},
        "frequency": {"load_g": 0.0, "bias_kV": None, "amplitude_kV": None},
    }
    units_add = "compliances"
    responses: ClassVar[Mapping[str, str]] = {
        "strain": "1",
        "displacement": "m",
        "current": "A",
        "gain": "1/V",
        "phase": "rad",
    }
    zero_at_rest = ("strain", "displacement")
    proportional: ClassVar[tuple[str, ...]] = ("gain",)
    required_quantities: ClassVar[Mapping[str, str]] = {
        "thickness": "m",
        "relative_permittivity": "1",
    }
    optional_quantities: ClassVar[Mapping[str, str]] = {
        "active_length": "m",
        "cross_section": "m^2",
        "total_mass": "kg",
        "active_mass": "kg",
        "sensor_mass": "kg",
        "series_resistance": "ohm",
        "leakage_resistance": "ohm",
        "capacitance": "F",
        "sensor_delay": "s",
    }
    meanings: ClassVar[Mapping[str, str]] = MEANINGS
    headline = ("E_0", "strain_per_kV2_total", "resonance_frequency", "electrical_time_constant",
                "tau_*", "compliance_total")  # fmt: skip

    circuit: bool
    """Whether the candidate has R_S, R_L and C."""
    inertia: bool
    """Whether the candidate has mass."""

    @property
    def massless(self) -> bool:
        return not self.inertia

    def uncertain(self, symbols: Mapping[str, str | tuple[str, str]]) -> tuple[Parameter, ...]:
        """Return the quantities in `symbols` that have an sd, as parameters."""
        units = {**self.required_quantities, **self.optional_quantities, "moving_mass": "kg"}
        return uncertain_quantities(
            replace(self.specimen, quantities=self.stated()), symbols, units
        )

    @cached_property
    def _stated(self) -> Mapping[str, Quantity]:
        return self.stated()

    def stated(self) -> Mapping[str, Quantity]:
        """Return the specimen's quantities, and `moving_mass` if all masses are given."""
        given = self.specimen.quantities
        if not set(MASSES) <= set(given):
            return given
        return {**given, "moving_mass": moving_quantity(*(given[name] for name in MASSES))}

    def quantity(self, name: str, draws: Draws) -> FloatArray:
        """Return a quantity's draws (W,) if it is a parameter, else its value repeated, (W,)."""
        given = draws.get(name)
        if given is not None:
            return given
        return np.full(np.shape(next(iter(draws.values()), np.zeros(1))), self._stated[name].value)

    def gain(self, response: str, draws: Draws) -> FloatArray:
        """Pressure at 1 V (W,); multiplied by the active length for a displacement."""
        pressure = self.pressure(1.0, draws)
        if response != "displacement":
            return pressure
        return pressure * self.quantity("active_length", draws)

    def pressure(self, voltage: float, draws: Draws) -> FloatArray:
        """Maxwell pressure at `voltage`, (W,); NaN if the thickness is not positive."""
        thickness = self.quantity("thickness", draws)
        thickness = np.where(thickness > 0.0, thickness, np.nan)
        return maxwell_pressure(voltage, thickness, self.quantity("relative_permittivity", draws))

    def circuit_of(self, draws: Draws) -> Circuit:
        """Return the circuit with R_S, R_L and C of the draws."""
        return cached(
            draws,
            (self, "circuit"),
            lambda: Circuit(*(self.quantity(name, draws) for name in CIRCUIT_SYMBOLS)),
        )

    def cautions(self, experiment: Experiment) -> tuple[str, ...]:
        """Warn if a sine needs more current than the amplifier can supply, by (16)."""
        limit = instrument(self.specimen, "current_limit", "current", "A")
        drive, given = drive_of(experiment), self.specimen.quantities
        if limit is None or drive is None or not given.keys() >= CIRCUIT_SYMBOLS.keys():
            return ()
        stated = Circuit(*(np.array([given[name].value]) for name in CIRCUIT_SYMBOLS))
        current = float(stated.current_amplitude(drive[0], np.array([drive[1]]))[0, 0])
        if current <= limit.value:
            return ()
        return (
            f"{experiment.name}: a sine of {drive[0]:.4g} V at {drive[1]:.4g} Hz takes "
            f"{1e3 * current:.3g} mA by (16), more than the amplifier's {1e3 * limit.value:.3g} mA,"
            " so its voltage is distorted",
        )

    def current_simulator(self, excitation: Excitation, coordinate: FloatArray) -> Simulator:
        """Return the simulator of the amplifier's current (W, N) [A] at the recorded voltage."""
        supply = Supply.of(excitation.coordinate, excitation.values, coordinate)
        return lambda draws: self.circuit_of(draws).supplied(supply)


def bias(excitation: Excitation) -> float:
    """Return the bias B [V] of a frequency response.

    Without a bias, the pressure under a sine has no term at the frequency of the sine.
    """
    given = excitation.conditions.get("bias_kV")
    if given is None or isinstance(given, str) or not given > 0.0:
        found = "none" if given is None else repr(given)
        raise UserError(
            "a frequency response needs its bias voltage as bias_kV (a column of "
            f"experiments.csv, in kV, larger than 0); found {found}"
        )
    return KILOVOLT * given


def refuse_two_delays(specimen: Specimen) -> None:
    """Check that a delay is not both modelled and subtracted from the records.

    Raises
    ------
    UserError
    """
    if "sensor_delay" not in specimen.quantities:
        return
    for response in ("strain", "displacement", "phase"):
        known = instrument(specimen, "delay", response, "s")
        if known is not None and known.value != 0.0:
            raise UserError(
                f"specimen {specimen.name!r} states the sensor's delay twice: as "
                "instruments.delay, which is taken out of the records, and as "
                "quantities.sensor_delay, which is modelled; keep the second if it has an sd"
            )


def load_mass(excitation: Excitation) -> float:
    """Return m_LOAD [kg] of a record."""
    given = excitation.conditions.get("load_g", 0.0)
    if isinstance(given, str) or not given >= 0.0:
        raise UserError(f"condition load_g must be a mass in g, zero or more; found {given!r}")
    return GRAM * given
