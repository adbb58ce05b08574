r"""The tubular actuator as a linear model, for control.

Strain is linear in the square of the voltage v across the electrodes, whatever its size:
sigma = k v^2 with k = epsilon_0 epsilon_r / d^2, Sarban et al. (2012), (6). It is linear in the
amplifier's voltage for small deviations from a bias V_0 only. The circuit (4) is linear and
settles at v_0 = V_0 R_L / (R_L + R_S), so that to first order

dsigma = 2 k v_0 dv,   dv' = (g dv_AMP - dv) / tau_e,   g = R_L / (R_L + R_S),

which is exactly the term of frequency f of a biased sine's pressure, beta_1 + i alpha_1 of (11).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.state_space import StateSpace
from deabayes.systems.circuit import Circuit
from deabayes.systems.linear_model import At, LinearModel, Signal

STRAIN = Signal("strain", "1", "strain of the active length")
SQUARE = Signal("voltage_squared", "V^2", "square of the voltage across the electrodes")
VOLTAGE = Signal("voltage", "V", "amplifier output")
CHARGE = Signal("capacitor_voltage", "V", "voltage across the electrodes")


@dataclass(frozen=True)
class DrivenChain:
    """Draws of an actuator: pressure to strain, k (W,) [Pa/V^2] and, if any, the circuit."""

    space: StateSpace
    pressure_per_square: FloatArray
    moves: bool
    circuit: Circuit | None

    def squared(self) -> LinearModel:
        """From the squared voltage across the electrodes; exact for any voltage."""
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
        """From deviations of the amplifier's voltage about a bias V_0 [V] to those of strain."""
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
    """The systems fed by the circuit, whose voltage becomes their last state."""
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
