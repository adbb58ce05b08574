"""The simulated tubular actuator in time: amplifier, circuit and moving chain by DOP853."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from data.make.tubular_truth import Truth

from deabayes.experiment import FloatArray

Command = Callable[[float], float]
Stretch = tuple[Callable[[FloatArray], FloatArray], tuple[float, float]]


@dataclass(frozen=True)
class Motion:
    """What a command does to the actuator at rest; functions of the time (N,) since the command.

    Attributes
    ----------
    truth : the actuator.
    command : voltage [V] asked of the amplifier from time 0 on, more than R_S I_max at first.
    stretches : solution and time span at the amplifier's current limit, and after it.
    """

    truth: Truth
    command: Command
    stretches: tuple[Stretch, Stretch]

    def states(self, time: FloatArray) -> FloatArray:
        """v_C, S, S' and the strains of the Kelvin units (n, N); at rest before time 0."""
        limited, free = (states(np.clip(time, *ends)) for states, ends in self.stretches)
        found = np.where(time < self.stretches[1][1][0], limited, free)
        return np.where(time < 0.0, 0.0, found)

    def current(self, time: FloatArray) -> FloatArray:
        """The amplifier's current [A]."""
        asked = np.array([self.command(max(float(t), 0.0)) for t in time])
        current = (asked - self.states(time)[0]) / self.truth.series_resistance
        limit = self.truth.current_limit
        return np.where(time < 0.0, 0.0, np.clip(current, -limit, limit))

    def amplifier(self, time: FloatArray) -> FloatArray:
        """The amplifier's output voltage [V]."""
        return self.states(time)[0] + self.truth.series_resistance * self.current(time)

    def displacement(self, time: FloatArray) -> FloatArray:
        """Of the actuator's end [m]."""
        return self.truth.active_length * self.states(time)[1]


def motion(truth: Truth, command: Command, duration: float, load: float = 0.0) -> Motion:
    """Solve the actuator under a load [kg] from rest: at the current limit, then free of it.

    The amplifier holds its current limit until v_C + R_S I_max reaches the command.
    Dielectric absorption, which takes seconds, is left to the leakage record.
    """
    from scipy.integrate import solve_ivp

    slope = _slope(truth, command, truth.inertia(load))

    def released(time: float, state: FloatArray) -> float:
        return float(state[0] + truth.series_resistance * truth.current_limit - command(time))

    released.terminal = True  # type: ignore[attr-defined]
    start = np.zeros(3 + len(truth.tau))
    options = {
        "method": "DOP853",
        "rtol": 1e-9,
        "atol": [1e-6, 1e-12, 1e-10, *(1e-12,) * len(truth.tau)],
        "dense_output": True,
        # Longer steps are stable but interpolate badly between.
        "max_step": 0.5 * truth.series_resistance * truth.capacitance,
    }
    limited = solve_ivp(slope, (0.0, duration), start, events=released, **options)
    end = float(limited.t[-1])
    free = solve_ivp(slope, (end, duration), limited.y[:, -1], **options)
    return Motion(truth, command, ((limited.sol, (0.0, end)), (free.sol, (end, duration))))


def _slope(
    truth: Truth, command: Command, inertia: float
) -> Callable[[float, FloatArray], list[float]]:
    """Right-hand side of Sarban et al. (2012), (2) as first-order equations and (4)."""
    pressure_per_square = float(truth.pressure(1.0))
    units = list(zip(truth.E[1:], truth.tau, strict=True))

    def slope(time: float, state: FloatArray) -> list[float]:
        volts, strain, rate, *strains = state.tolist()
        current = (command(time) - volts) / truth.series_resistance
        current = max(-truth.current_limit, min(current, truth.current_limit))
        current -= volts / truth.leakage_resistance
        borne = truth.E[0] * (strain - sum(strains))
        acceleration = (pressure_per_square * volts**2 - borne) / inertia
        flow = [(borne / e - x) / tau for x, (e, tau) in zip(strains, units, strict=True)]
        return [current / truth.capacitance, rate, acceleration, *flow]

    return slope


def leakage_current(truth: Truth, voltage: float, time: FloatArray) -> FloatArray:
    """Current [A] at times (N,) since a voltage was put on, after the few ms of charging.

    What leaks, and what the dielectric still absorbs, each branch on its own: the series
    resistance is a millionth of any of theirs.
    """
    current = np.full(time.shape, voltage / (truth.series_resistance + truth.leakage_resistance))
    for resistance, constant in truth.branches():
        current = current + voltage / resistance * np.exp(-np.maximum(time, 0.0) / constant)
    return np.where(time < 0.0, 0.0, current)
