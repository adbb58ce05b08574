"""The tubular actuator's material: a solid that relaxes, and a linear model for control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.state_space import StateSpace
from deabayes.systems.solid import LINEAR, At, LinearModel, Note, Signal, Solid
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.voigt_kelvin import Chain

POISSON_RATIO = 0.495
NOTES = (
    "Linear, for strains below 5 %: the chain's creep compliance is taken for that of uniaxial "
    "stress. It is one-dimensional, strain along the tube by electrostatic pressure, so its moduli "
    "are effective ones of this tube with its electrodes",
    f"Poisson's ratio {POISSON_RATIO:g} is not from the records, which do not show it: silicone "
    "hardly changes its volume, and 0.495 (bulk modulus 33 times E_0) is as near to 0.5 as usual "
    "elements bear; elements with a pressure of their own take 0.4999 too. The bulk modulus does "
    "not relax",
    "The Prony series is the exact interconversion of the creep compliance: as many terms as "
    "Kelvin units, with shorter times than these have",
)
OTHERS = {
    "inertia": "Masses of the actuator and its load are no part of the material, and left out",
    "circuit": "Resistances and capacitance of the circuit are no part of the material",
}


def solid(chain: Chain, inertia: bool, circuit: bool) -> Solid:
    """Return the solid of every draw of a chain."""
    free = np.full_like(chain.instantaneous, POISSON_RATIO)
    shear = Chain(
        2.0 * (1.0 + POISSON_RATIO) * chain.instantaneous,
        3.0 * chain.compliances,
        chain.time_constants,
    )
    shares, times = shear.relaxation()
    also = [text for given, text in zip((inertia, circuit), OTHERS.values(), strict=True) if given]
    return Solid(
        LINEAR,
        {"E": 1.0 / chain.instantaneous},
        {"nu": free},
        True,
        shares,
        times,
        notes=tuple(Note(text) for text in (*NOTES, *also)),
    )


STRAIN = Signal("strain", "1", "strain of the active length")
SQUARE = Signal("voltage_squared", "V^2", "square of the voltage across the electrodes")
VOLTAGE = Signal("voltage", "V", "amplifier output")
CHARGE = Signal("capacitor_voltage", "V", "voltage across the electrodes")


@dataclass(frozen=True)
class DrivenChain:
    """Draws of an actuator: state space from pressure to strain, k (W,) [Pa/V^2], any circuit."""

    space: StateSpace
    pressure_per_square: FloatArray
    moves: bool
    circuit: Circuit | None

    def squared(self) -> LinearModel:
        """Return the model from the squared voltage across the electrodes to strain; exact."""
        gain = self.pressure_per_square
        space = self.space
        driven = StateSpace(space.a, gain[:, None] * space.b, space.c, gain * space.d)
        note = "exact for any voltage: strain is linear in the squared voltage"
        if self.circuit is not None:
            note += (
                "; the square is that of the voltage across the electrodes, behind the circuit, "
                "which is not part of this model (it is of one with a bias)"
            )
        return LinearModel(driven, SQUARE, STRAIN, self._states(), note, {})

    def about(self, bias: float) -> LinearModel:
        """Return the model from amplifier voltage to strain, linearised about a bias V_0 [V]."""
        settled = np.broadcast_to(bias, self.pressure_per_square.shape)
        if self.circuit is not None:
            settled = bias * self.circuit.gain
        slope = 2.0 * self.pressure_per_square * settled
        space = self.space
        driven = StateSpace(space.a, slope[:, None] * space.b, space.c, slope * space.d)
        states = self._states()
        if self.circuit is not None:
            driven, states = _behind(self.circuit, driven), (*states, CHARGE)
        states = tuple(_deviation(state) for state in states)
        note = (
            "to first order about the bias: input, states and output are deviations from the "
            "operating point, and what the square of a voltage deviation v adds is left out, "
            "v / (2 bias) of what is kept"
        )
        point = self._operating_point(bias, settled)
        return LinearModel(driven, _deviation(VOLTAGE), _deviation(STRAIN), states, note, point)

    def _operating_point(self, bias: float, settled: FloatArray) -> dict[str, At]:
        pressure = self.pressure_per_square * settled**2
        at_rest = np.linalg.solve(self.space.a, self.space.b[:, :, None])[:, :, 0]
        compliance = self.space.d - np.sum(self.space.c * at_rest, axis=1)
        return {
            "bias": At("V", "amplifier output", np.asarray(bias)),
            "capacitor_voltage": At("V", "voltage across the electrodes", settled),
            "pressure": At("Pa", "electrostatic pressure", pressure),
            "strain": At("1", "steady strain", pressure * compliance),
        }

    def _states(self) -> tuple[Signal, ...]:
        units = self.space.b.shape[1] - (2 if self.moves else 0)
        chain = tuple(
            Signal(f"strain_{n}", "1", f"strain of Kelvin unit {n}") for n in range(1, units + 1)
        )
        rate = Signal("strain_rate", "1/s", "strain rate")
        return (STRAIN, rate, *chain) if self.moves else chain


def _behind(circuit: Circuit, space: StateSpace) -> StateSpace:
    """Put the circuit before the systems; the voltage v_C becomes their last state."""
    draws, states = space.b.shape
    decay = 1.0 / circuit.time_constant
    a = np.zeros((draws, states + 1, states + 1))
    a[:, :states, :states], a[:, :states, states] = space.a, space.b
    a[:, states, states] = -decay
    b = np.zeros((draws, states + 1))
    b[:, states] = circuit.gain * decay
    return StateSpace(a, b, np.column_stack([space.c, space.d]), np.zeros(draws))


def _deviation(signal: Signal) -> Signal:
    text = f"{signal.description}, deviation from the operating point"
    return Signal(f"{signal.name}_deviation", signal.unit, text)
