"""Tubular actuator: a Voigt-Kelvin chain under Maxwell pressure, optionally with mass, circuit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import ClassVar, Literal

import numpy as np

from deabayes.experiment import Excitation, FloatArray, Specimen
from deabayes.faults import UserError
from deabayes.integrate.linear import Hold, hold, relaxation_response
from deabayes.integrate.modal import modal_response
from deabayes.integrate.state_space import StateSpace
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Derived, Draws, Simulator, System, UnknownCandidate, cached
from deabayes.systems.delayed import AtOnce, delayed, shifted
from deabayes.systems.solid import LinearModel, Solid
from deabayes.systems.tubular import voigt_kelvin
from deabayes.systems.tubular.base import (
    CIRCUIT_SYMBOLS,
    INERTIA_SYMBOLS,
    KILOVOLT,
    MASSES,
    QUANTITY_SYMBOLS,
    TubularBase,
    bias,
    load_mass,
    refuse_two_delays,
)
from deabayes.systems.tubular.material import DrivenChain, solid
from deabayes.systems.tubular.sine import Harmonic, phase
from deabayes.systems.tubular.voigt_kelvin import MovingChain

CIRCUIT_CANDIDATE = "circuit"


class TubularCircuit(TubularBase):
    """The circuit R_S, R_L and C of (4)-(5) of Sarban et al. (2012), without strain.

    The response is the amplifier's current under its recorded voltage. R_S, R_L and C are
    parameters if the specimen gives them an sd. The posterior can be a prior for candidates with
    `_circuit` (`prior_from`). The order is 0, because there is no Kelvin unit.
    """

    excitations: ClassVar[Mapping[str, str]] = {"voltage": "V"}
    responses: ClassVar[Mapping[str, str]] = {"current": "A"}
    proportional: ClassVar[tuple[str, ...]] = ()

    def __init__(self, candidate: str, specimen: Specimen) -> None:
        if candidate != CIRCUIT_CANDIDATE:
            raise UserError(
                f"candidate {candidate!r} is no circuit alone; write {CIRCUIT_CANDIDATE!r}"
            )
        self.candidate = candidate
        self.specimen = specimen
        self.order = 0
        self.circuit, self.inertia = True, False
        for name in CIRCUIT_SYMBOLS:
            self.require(name, "a circuit")

    @classmethod
    def candidates(cls) -> tuple[str, ...]:
        return (CIRCUIT_CANDIDATE,)

    def parameters(self) -> tuple[Parameter, ...]:
        return self.uncertain(CIRCUIT_SYMBOLS)

    def check_channels(self, excitation: str, response: str) -> None:
        if excitation not in self.excitations or response not in self.responses:
            raise UserError(
                f"candidate {CIRCUIT_CANDIDATE!r} computes the response 'current' to 'voltage', "
                f"not {response!r} to {excitation!r}; leave such records out of its study"
            )

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        self.check_channels(excitation.name, response)
        return self.current_simulator(excitation, coordinate)

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return the two time constants of the circuit, see `Circuit.derived`."""
        return self.circuit_of(draws).derived()


CHAIN_CANDIDATE = re.compile(r"voigt_kelvin_([1-9]\d?)(_inertia)?(_circuit)?")


class Tubular(TubularBase):
    r"""The core-free tubular actuator of Sarban et al. (2012).

    The strain S is the response of a spring and K Kelvin units in series to the
    electrostatic pressure sigma = epsilon_0 epsilon_r (v / d)^2, (6):

    S = sigma / E_0 + sum_n x_n,   tau_n x_n' = -x_n + sigma / E_n,   n = 1..K,

    The response to a pressure step is the creep compliance D(t) of (1). The voltage is the
    amplifier's output, linear between the knots of the excitation. So the pressure is quadratic
    between knots, and the solution is exact, also at a jump. Before the first knot the actuator is
    at rest without voltage.

    Candidates `voigt_kelvin_K` have the parameters `E_0`, `E_1..K` [Pa] and `tau_1..K` [s]. Two
    endings extend the model, alone or in this order:
    `_inertia` adds the mass M = (m_DE + m_LVDT + m_LOAD) L_0 / A_0, (13), where m_LOAD is the
    record's `load_g`. Then S is the solution of (2).
    `_circuit` adds the resistances and the capacitance between the amplifier's output and the
    voltage v of the pressure, (4)-(5).
    The specimen gives the masses and the circuit; those with an sd are parameters.

    Creep determines only the ratios sigma / E_n. Therefore the moduli inherit the uncertainty of
    `relative_permittivity` and `thickness`, which are parameters if they have an sd. Displacement
    is strain times `active_length`. Current needs the circuit and does not depend on the chain.
    """

    def __init__(self, candidate: str, specimen: Specimen) -> None:
        match = CHAIN_CANDIDATE.fullmatch(candidate)
        if match is None:
            raise UnknownCandidate(
                f"candidate {candidate!r} is unknown for system 'tubular'; "
                "write voigt_kelvin_K with K Kelvin units, e.g. voigt_kelvin_2, and "
                "_inertia, _circuit or _inertia_circuit behind it if wanted; or circuit, for "
                "records of current alone"
            )
        self.candidate = candidate
        self.specimen = specimen
        self.order = int(match.group(1))
        self.inertia, self.circuit = match.group(2) is not None, match.group(3) is not None
        for name in self.required_quantities:
            self.require(name)
        for name in ("active_length", "cross_section", *MASSES) if self.inertia else ():
            self.require(name, "inertia")
        for name in CIRCUIT_SYMBOLS if self.circuit else ():
            self.require(name, "a circuit")
        refuse_two_delays(specimen)

    @classmethod
    def of(cls, candidate: str, specimen: Specimen) -> System:
        """Build the system with the chain, or `TubularCircuit` for the candidate `circuit`."""
        kind = TubularCircuit if candidate in TubularCircuit.candidates() else cls
        return kind(candidate, specimen)

    @classmethod
    def candidates(cls) -> tuple[str, ...]:
        """Return the candidates with K = 1, 2 and 3; larger K and the endings are allowed too."""
        return ("voigt_kelvin_1", "voigt_kelvin_2", "voigt_kelvin_3")

    def parameters(self) -> tuple[Parameter, ...]:
        used: dict[str, str | tuple[str, str]] = {**QUANTITY_SYMBOLS}
        if self.inertia:
            used.update(INERTIA_SYMBOLS)
        if self.circuit:
            used.update(CIRCUIT_SYMBOLS)
        return (*voigt_kelvin.parameters(self.order), *self.uncertain(used))

    def check_channels(self, excitation: str, response: str) -> None:
        super().check_channels(excitation, response)
        if response == "current" and not self.circuit:
            raise UserError(
                f"candidate {self.candidate!r} has no circuit, so no response 'current'; write "
                f"{self.candidate}_circuit or circuit, or leave records of current out of its study"
            )

    def simulator(self, excitation: Excitation, coordinate: FloatArray, response: str) -> Simulator:
        self.check_channels(excitation.name, response)
        if excitation.name == "frequency":
            return self._harmonic_simulator(excitation, coordinate, response)
        if response == "current":
            return self.current_simulator(excitation, coordinate)
        if response == "displacement":
            self.require("active_length")
        simulator_at = partial(self._strain_simulator, excitation, response)
        delay, start = self.specimen.quantities.get("sensor_delay"), float(excitation.coordinate[0])
        if delay is None:
            return simulator_at(coordinate)
        if delay.sd is None:
            return shifted(simulator_at, coordinate, delay.value, start)
        spring = None if self.inertia else self._series_spring(excitation, response)
        smooth_at = partial(simulator_at, spring=spring is None)
        return delayed(smooth_at, coordinate, delay, "sensor_delay", start, spring)

    def _series_spring(self, excitation: Excitation, response: str) -> AtOnce:
        """Strain of the series spring without mass, in proportion to v^2, or v_C^2 with circuit."""
        knots, values = excitation.coordinate, excitation.values

        def strain(draws: Draws, times: FloatArray) -> FloatArray:
            if self.circuit:
                voltage = self.circuit_of(draws).charge(knots, values, times)
            else:
                voltage = excitation.at(times)
            voltage *= voltage
            voltage *= (self.gain(response, draws) * self._chain(draws).instantaneous)[:, None]
            return voltage

        return strain

    def _strain_simulator(
        self, excitation: Excitation, response: str, coordinate: FloatArray, spring: bool = True
    ) -> Simulator:
        """Simulator of strain or displacement (W, N); `spring` includes the series spring."""
        power: Literal[1, 2] = 1 if self.circuit else 2
        load = hold(excitation.coordinate, excitation.values, coordinate, power)
        mass = load_mass(excitation)

        def simulate(draws: Draws) -> FloatArray:
            chain = self._chain(draws)
            if not spring:
                chain = replace(chain, instantaneous=np.zeros_like(chain.instantaneous))
            gain = self.gain(response, draws)
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
        """Simulator of gain [1/V] or phase [rad] of the strain at the frequencies, (W, F)."""
        conditions = bias(excitation), load_mass(excitation)  # errors appear before any draw
        key = self, "harmonic", *conditions, frequency.tobytes()

        def simulate(draws: Draws) -> FloatArray:
            harmonic = cached(
                draws, key, lambda: self.harmonic(excitation, draws).per_volt(frequency)
            )
            if response == "gain":
                return np.abs(harmonic)
            lag = phase(harmonic)
            if "sensor_delay" not in self.specimen.quantities:
                return lag
            return lag - 2.0 * np.pi * self.quantity("sensor_delay", draws)[:, None] * frequency

        return simulate

    def harmonic(self, excitation: Excitation, draws: Draws) -> Harmonic:
        """Return the response to a sine about the bias of a record, under its load."""
        chain: voigt_kelvin.Chain | MovingChain
        chain = self._chain(draws)
        if self.inertia:
            chain = MovingChain(chain, self._inertial_parameter(load_mass(excitation), draws))
        circuit = self.circuit_of(draws) if self.circuit else None
        return Harmonic(chain, circuit, self.pressure(1.0, draws), bias(excitation))

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return final strains at 1 kV, compliances, viscosities, and those of mass and circuit.

        `strain_per_kV2_n` = epsilon_0 epsilon_r (1 kV / d)^2 / E_n [1] is the strain that spring n
        reaches at 1 kV; `_total` is the sum. Creep records determine it without permittivity and
        thickness. For compliances and viscosities see `voigt_kelvin.Chain.derived`. Inertia adds
        M and the resonance of the unloaded actuator, see `voigt_kelvin.MovingChain.derived`. A
        circuit adds its time constants, see `circuit.Circuit.derived`.
        """
        chain = self._chain(draws)
        springs = np.column_stack([chain.instantaneous, chain.compliances])
        strains = self.pressure(KILOVOLT, draws)[:, None] * springs
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
        if self.circuit:
            result |= self.circuit_of(draws).derived()
        return result | chain.derived()

    def linear_model(
        self, draws: Draws, load: float = 0.0, bias: float | None = None
    ) -> LinearModel:
        """Return the model from the squared voltage, or linearised about a bias, see `material`."""
        if load and not self.inertia:
            raise UserError(
                f"candidate {self.candidate!r} has no mass, so no load can hang from it; "
                "take a candidate with _inertia or leave the load out"
            )
        chain = self._chain(draws)
        driven = DrivenChain(
            self._space(chain, load, draws),
            self.pressure(1.0, draws),
            self.inertia,
            self.circuit_of(draws) if self.circuit else None,
        )
        return driven.squared() if bias is None else driven.about(bias)

    def solid(self, draws: Draws) -> Solid:
        """Return a linear elastic solid with the relaxation of the chain, see `material`."""
        return solid(self._chain(draws), self.inertia, self.circuit)

    def _per_square(
        self, driven: Hold, load: float, chain: voigt_kelvin.Chain, draws: Draws
    ) -> FloatArray:
        """Strain (W, N) from the state space, with the squared voltage as the pressure.

        driven : the amplifier's voltage if there is a circuit, else the squared voltage.
        """
        space = self._space(chain, load, draws)
        if self.circuit:
            return self.circuit_of(draws).drive(space, driven)
        return modal_response(space, driven)

    def _chain(self, draws: Draws) -> voigt_kelvin.Chain:
        return cached(
            draws, (self, "chain"), lambda: voigt_kelvin.Chain.from_draws(draws, self.order)
        )

    def _space(self, chain: voigt_kelvin.Chain, load: float, draws: Draws) -> StateSpace:
        """State space from pressure to strain, under a load [kg] if the candidate has mass."""
        if not self.inertia:
            return chain.state_space()
        return MovingChain(chain, self._inertial_parameter(load, draws)).state_space()

    def _inertial_parameter(self, load: float, draws: Draws) -> FloatArray:
        """M = (m_DE + m_LVDT + m_LOAD) L_0 / A_0 (W,) [kg/m], (13), under a load [kg]."""
        moving, area, length = (
            self.quantity(name, draws) for name in (*INERTIA_SYMBOLS, "active_length")
        )
        return np.asarray((moving + load) * length / area)
