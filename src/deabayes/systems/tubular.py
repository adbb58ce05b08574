"""Tubular actuator: a Voigt-Kelvin chain under Maxwell pressure, with mass and circuit if asked."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from deabayes.electrostatics import maxwell_pressure
from deabayes.experiment import Excitation, FloatArray, Specimen
from deabayes.faults import UserError
from deabayes.integrate.linear import Hold, hold, relaxation_response
from deabayes.integrate.state_space import StateSpace
from deabayes.parameter import Parameter
from deabayes.systems import voigt_kelvin
from deabayes.systems.base import Derived, Draws, Simulator, System
from deabayes.systems.circuit import Circuit
from deabayes.systems.inertial_parameter import inertial_parameter
from deabayes.systems.linear_model import LinearModel
from deabayes.systems.specimen_quantities import uncertain_quantities
from deabayes.systems.tubular_linear import DrivenChain
from deabayes.systems.tubular_sine import Harmonic, phase
from deabayes.systems.voigt_kelvin_inertia import MovingChain

CANDIDATE = re.compile(r"voigt_kelvin_([1-9]\d?)(_inertia)?(_circuit)?")
KILOVOLT, GRAM = 1e3, 1e-3
QUANTITY_SYMBOLS = {
    "relative_permittivity": r"\varepsilon_r",
    "thickness": "d",
    "active_length": "L_0",
}
"""The quantities every candidate computes with."""
INERTIA_SYMBOLS = {
    "total_mass": r"m_\mathrm{total}",
    "active_mass": r"m_\mathrm{active}",
    "sensor_mass": r"m_\mathrm{LVDT}",
    "cross_section": "A_0",
}
"""Those that `_inertia` adds; it needs them all, and the active length."""
CIRCUIT_SYMBOLS = {
    "series_resistance": "R_S",
    "leakage_resistance": "R_L",
    "capacitance": "C",
}
"""Those that `_circuit` adds and needs."""


class Tubular(System):
    r"""The core-free tubular actuator of Sarban et al. (2012).

    The strain S is the response of K Kelvin units and a spring in series to the
    electrostatic pressure sigma = epsilon_0 epsilon_r (v / d)^2, (6):

    S = sigma / E_0 + sum_n x_n,   tau_n x_n' = -x_n + sigma / E_n,   n = 1..K,

    whose answer to a pressure step is the creep compliance D(t) of (1). The voltage
    is the amplifier's output, linear between the knots of the excitation, so the
    pressure is quadratic between them; that is solved exactly, a jump included.
    Before its first knot the actuator is at rest without voltage.

    Candidates `voigt_kelvin_K` have the parameters `E_0`, `E_1..K` [Pa] and
    `tau_1..K` [s]. Two endings add to the model, alone or in this order:
    `_inertia` the mass M = (m_DE + m_LVDT + m_LOAD) L_0 / A_0, (13), which makes S the
    solution of (2), m_LOAD being the record's `load_g`; `_circuit` the resistances and the
    capacitance between the amplifier's output and the voltage v of the pressure, (4)-(5).
    Masses and circuit are the specimen's, and parameters where they carry an sd.

    Creep fixes only the ratios sigma / E_n; the moduli inherit the
    uncertainty of `relative_permittivity` and `thickness`, which are parameters
    where the specimen gives them an sd. A record of displacement is strain times
    `active_length`.
    """

    name: ClassVar[str] = "tubular"
    protocols: ClassVar[tuple[str, ...]] = ("creep", "step", "sine", "frequency_response")
    excitations: ClassVar[Mapping[str, str]] = {"voltage": "V", "frequency": "Hz"}
    responses: ClassVar[Mapping[str, str]] = {
        "strain": "1",
        "displacement": "m",
        "current": "A",
        "gain": "1/V",
        "phase": "rad",
    }
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
    }

    def __init__(self, candidate: str, specimen: Specimen) -> None:
        match = CANDIDATE.fullmatch(candidate)
        if match is None:
            raise UserError(
                f"candidate {candidate!r} is unknown for system 'tubular'; "
                "write voigt_kelvin_K with K Kelvin units, e.g. voigt_kelvin_2, and "
                "_inertia, _circuit or _inertia_circuit behind it if wanted"
            )
        self.candidate = candidate
        self.specimen = specimen
        self.order = int(match.group(1))
        self.inertia, self.circuit = match.group(2) is not None, match.group(3) is not None
        for name in self.required_quantities:
            self.require(name)
        for name in ("active_length", *INERTIA_SYMBOLS) if self.inertia else ():
            self.require(name, "inertia")
        for name in CIRCUIT_SYMBOLS if self.circuit else ():
            self.require(name, "a circuit")

    @classmethod
    def candidates(cls) -> tuple[str, ...]:
        """The usual candidates, of 3, 5 and 7 parameters; any K and the endings work."""
        return ("voigt_kelvin_1", "voigt_kelvin_2", "voigt_kelvin_3")

    def parameters(self) -> tuple[Parameter, ...]:
        units = {**self.required_quantities, **self.optional_quantities}
        used = QUANTITY_SYMBOLS | (INERTIA_SYMBOLS if self.inertia else {})
        used |= CIRCUIT_SYMBOLS if self.circuit else {}
        uncertain = uncertain_quantities(self.specimen, used, units)
        return (*voigt_kelvin.parameters(self.order), *uncertain)

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        self.check_channels(excitation.name, response)
        if excitation.name == "frequency":
            return self._harmonic_simulator(excitation, coordinate, response)
        if response == "current":
            raise UserError("response 'current' of system 'tubular' has no model yet")
        if response == "displacement":
            self.require("active_length")
        power: Literal[1, 2] = 1 if self.circuit else 2
        load = hold(excitation.coordinate, excitation.values, coordinate, power)
        mass = _hung(excitation) if self.inertia else 0.0

        def simulate(draws: Draws) -> FloatArray:
            chain = voigt_kelvin.Chain.from_draws(draws, self.order)
            gain = self._pressure(1.0, draws)
            if response == "displacement":
                gain = gain * self._quantity("active_length", draws)
            if self.inertia or self.circuit:
                return gain[:, None] * self._per_square(load, mass, chain, draws)
            return relaxation_response(
                load,
                gain * chain.instantaneous,
                gain[:, None] * chain.compliances,
                chain.time_constants,
            )

        return simulate

    def _harmonic_simulator(
        self, excitation: Excitation, frequency: FloatArray, response: str
    ) -> Simulator:
        """Gain [1/V] or phase [rad] of the strain's term of each frequency (W, F)."""
        _bias(excitation), _hung(excitation)  # said before a draw is made

        def simulate(draws: Draws) -> FloatArray:
            harmonic = self.harmonic(excitation, draws).per_volt(frequency)
            return np.abs(harmonic) if response == "gain" else phase(harmonic, frequency)

        return simulate

    def harmonic(self, excitation: Excitation, draws: Draws) -> Harmonic:
        """The answer to a small sine about the record's bias, under its load."""
        chain: voigt_kelvin.Chain | MovingChain
        chain = voigt_kelvin.Chain.from_draws(draws, self.order)
        bias = _bias(excitation)
        if self.inertia:
            chain = MovingChain(chain, self._inertial_parameter(_hung(excitation), draws))
        circuit = self._circuit(draws) if self.circuit else None
        return Harmonic(chain, circuit, self._pressure(1.0, draws), bias)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """What creep determines and what the chain means.

        `strain_per_kV2_n` = epsilon_0 epsilon_r (1 kV / d)^2 / E_n [1], the strain
        that spring n reaches at 1 kV (and `_total`, their sum), is fixed by creep
        records whatever the permittivity and the thickness. Compliances and
        viscosities: see `voigt_kelvin.Chain.derived`; with inertia, M and the resonance
        of the unloaded actuator too: `voigt_kelvin_inertia.MovingChain.derived`.
        """
        chain = voigt_kelvin.Chain.from_draws(draws, self.order)
        springs = np.column_stack([chain.instantaneous, chain.compliances])
        strains = self._pressure(KILOVOLT, draws)[:, None] * springs
        result = {
            f"strain_per_kV2_{n}": Derived(
                rf"\sigma_{{1\,\mathrm{{kV}}}}/E_{{{n}}}",
                "1",
                f"final strain of {f'Kelvin unit {n}' if n else 'the series spring'} at 1 kV",
                strain,
            )
            for n, strain in enumerate(strains.T)
        }
        result["strain_per_kV2_total"] = Derived(
            r"\sigma_{1\,\mathrm{kV}} D(\infty)", "1", "final strain at 1 kV", strains.sum(axis=1)
        )
        if self.inertia:
            result |= MovingChain(chain, self._inertial_parameter(0.0, draws)).derived()
        return result | chain.derived()

    def linear_model(
        self, draws: Draws, load: float = 0.0, bias: float | None = None
    ) -> LinearModel:
        """From the squared voltage, or about a bias: see `tubular_linear`."""
        if load and not self.inertia:
            raise UserError(
                f"candidate {self.candidate!r} has no mass, so no load can hang from it; "
                "take a candidate with _inertia or leave the load out"
            )
        chain = voigt_kelvin.Chain.from_draws(draws, self.order)
        driven = DrivenChain(
            self._space(chain, load, draws),
            self._pressure(1.0, draws),
            self.inertia,
            self._circuit(draws) if self.circuit else None,
        )
        return driven.squared() if bias is None else driven.about(bias)

    def _per_square(
        self, driven: Hold, load: float, chain: voigt_kelvin.Chain, draws: Draws
    ) -> FloatArray:
        """Strain (W, N) if the pressure were the square of the voltage, by the state space.

        driven : the amplifier's voltage if there is a circuit, else the voltage squared.
        """
        space = self._space(chain, load, draws)
        return self._circuit(draws).drive(space, driven) if self.circuit else space.response(driven)

    def _space(self, chain: voigt_kelvin.Chain, load: float, draws: Draws) -> StateSpace:
        """From pressure to strain, under a load [kg] if the candidate has mass."""
        if not self.inertia:
            return chain.state_space()
        return MovingChain(chain, self._inertial_parameter(load, draws)).state_space()

    def _circuit(self, draws: Draws) -> Circuit:
        """R_S, R_L and C of the draws."""
        parts = (self._quantity(name, draws) for name in CIRCUIT_SYMBOLS)
        return Circuit(*(np.broadcast_to(part, np.shape(draws["E_0"])) for part in parts))

    def _inertial_parameter(self, load: float, draws: Draws) -> FloatArray:
        """M (W,) [kg/m] under a load [kg]."""
        names = ("active_length", *INERTIA_SYMBOLS)
        parameter = inertial_parameter(
            load=load, **{name: self._quantity(name, draws) for name in names}
        )
        return np.broadcast_to(parameter, np.shape(draws["E_0"]))

    def _pressure(self, voltage: float, draws: Draws) -> FloatArray:
        """The Maxwell pressure at `voltage`, (W,); NaN where the thickness is not positive."""
        thickness = self._quantity("thickness", draws)
        thickness = np.where(thickness > 0.0, thickness, np.nan)
        pressure = maxwell_pressure(
            voltage, thickness, self._quantity("relative_permittivity", draws)
        )
        return np.broadcast_to(pressure, np.shape(draws["E_0"]))

    def _quantity(self, name: str, draws: Draws) -> FloatArray:
        """A quantity of the specimen: its draws where it is a parameter, else its value."""
        return np.asarray(draws.get(name, self.specimen.quantities[name].value))


def _bias(excitation: Excitation) -> float:
    """B [V] of a frequency response: the pressure, a square, follows a sine only about a bias."""
    given = excitation.conditions.get("bias_kV")
    if given is None or isinstance(given, str) or not given > 0.0:
        found = "none" if given is None else repr(given)
        raise UserError(
            "a frequency response needs its bias voltage as bias_kV (a column of "
            f"experiments.csv, in kV, larger than 0); found {found}"
        )
    return KILOVOLT * given


def _hung(excitation: Excitation) -> float:
    """m_LOAD [kg] of a record."""
    given = excitation.conditions.get("load_g", 0.0)
    if isinstance(given, str) or not given >= 0.0:
        raise UserError(f"condition load_g must be a mass in g, zero or more; found {given!r}")
    return GRAM * given
