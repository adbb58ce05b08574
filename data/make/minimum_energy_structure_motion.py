"""The simulated minimum-energy structure in time: amplifier, linkage and units by DOP853."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from data.make.minimum_energy_structure_truth import Truth

from deabayes.experiment import FloatArray

Command = Callable[[float], float]


@dataclass(frozen=True)
class Motion:
    """What a command does to the structure at rest; functions of the time (N,) since the command.

    Attributes
    ----------
    truth : the structure.
    command : voltage [V] asked of the amplifier from time 0 on.
    states : solution from time 0 on: amplifier's output, theta, theta' and the springs' extensions.
    """

    truth: Truth
    command: Command
    states: Callable[[FloatArray], FloatArray]

    def amplifier(self, time: FloatArray) -> FloatArray:
        """The amplifier's output voltage [V]."""
        if self.truth.amplifier_lag:
            volts = self.states(np.maximum(time, 0.0))[0]
        else:
            volts = np.array([self.command(float(t)) for t in time])
        return np.where(time < 0.0, 0.0, volts)

    def displacement(self, time: FloatArray) -> FloatArray:
        """Of the slider from its place at rest [m], outwards."""
        angle = self.states(np.maximum(time, 0.0))[1]
        rest = self.truth.rest_angle
        moved = 2.0 * self.truth.link_length * (np.cos(angle) - math.cos(rest))
        return np.where(time < 0.0, 0.0, moved)


def motion(truth: Truth, command: Command, duration: float) -> Motion:
    """Solve the structure from rest at 0 V, its Maxwell units relaxed."""
    from scipy.integrate import solve_ivp

    units = len(truth.k)
    start = np.array([0.0, truth.rest_angle, 0.0, *(0.0,) * units])
    solution = solve_ivp(
        _slope(truth, command), (0.0, duration), start, method="DOP853", rtol=1e-9,
        atol=[1e-6, 1e-11, 1e-9, *(1e-12,) * units], dense_output=True, max_step=5e-3,
    ).sol  # fmt: skip
    return Motion(truth, command, solution)


def _slope(truth: Truth, command: Command) -> Callable[[float, FloatArray], list[float]]:
    """Right-hand side of the paper's (11)-(23), all forces taken along the slider."""
    span = 2.0 * truth.link_length
    swing = 2.0 * (truth.rotational_inertia + truth.link_mass * truth.mass_centre**2)
    slide = truth.link_mass * (truth.link_length - truth.mass_centre)
    slide = 2.0 * span * (slide + truth.slider_mass * truth.link_length)
    units = list(zip(truth.k, truth.tau, strict=True))
    lag = truth.amplifier_lag

    def slope(time: float, state: FloatArray) -> list[float]:
        volts, angle, rate, *springs = state.tolist()
        cosine, sine = math.cos(angle), math.sin(angle)
        speed = -span * sine * rate
        driven = volts if lag else command(time)
        force = truth.static_force(angle, cosine, sine, driven) - truth.eta_0 * speed
        force -= truth.dry_friction * math.tanh(speed / truth.dry_friction_speed)
        flow = []
        for x, (k, tau) in zip(springs, units, strict=True):
            force -= k * x
            flow.append(speed - x / tau)
        moment = -span * sine * force - slide * sine * cosine * rate**2
        following = (command(time) - volts) / lag if lag else 0.0
        return [following, rate, moment / (swing + slide * sine**2), *flow]

    return slope
