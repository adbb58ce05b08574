r"""The circuit between amplifier and electrodes (Sarban et al. 2012).

A series resistance R_S feeds the capacitance C, which leaks through R_L beside it:

v_C' + v_C / tau_e = v_AMP / (R_S C),   tau_e = R_L R_S C / (R_L + R_S).     (4), (5)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.charged import charged_response
from deabayes.integrate.linear import Hold, hold, relaxation_response
from deabayes.integrate.state_space import StateSpace


@dataclass(frozen=True)
class Circuit:
    """Draws of R_S [ohm], R_L [ohm] and C [F], each (W,)."""

    series_resistance: FloatArray
    leakage_resistance: FloatArray
    capacitance: FloatArray

    @property
    def time_constant(self) -> FloatArray:
        """tau_e (W,) [s]."""
        return self.gain * self.series_resistance * self.capacitance

    @property
    def gain(self) -> FloatArray:
        """v_C / v_AMP of a steady voltage, R_L / (R_L + R_S), (W,)."""
        return self.leakage_resistance / (self.leakage_resistance + self.series_resistance)

    def charge(self, time: FloatArray, amplifier: FloatArray, coordinate: FloatArray) -> FloatArray:
        """v_C (W, N) [V] at `coordinate` for an amplifier voltage linear between `time` (M,).

        Exact; uncharged before the first time, where the voltage jumps to its first value.
        """
        load = hold(time, amplifier, coordinate)
        rest = np.zeros_like(self.gain)
        return relaxation_response(load, rest, self.gain[:, None], self.time_constant[:, None])

    def drive(self, space: StateSpace, voltage: Hold) -> FloatArray:
        """What v_C^2 does to linear systems, (W, N), from rest; exact, v_AMP held with power 1."""
        return charged_response(space, self.gain, 1.0 / self.time_constant, voltage)

    def current(self, amplifier: FloatArray, charged: FloatArray) -> FloatArray:
        """The amplifier's current (v_AMP - v_C) / R_S (W, N) [A]."""
        return (amplifier - charged) / self.series_resistance[:, None]

    def current_amplitude(self, amplitude: float, frequency: FloatArray) -> FloatArray:
        r"""I = omega C V / sqrt(1 + (omega R_S C)^2) (W, F) [A], (16), leakage neglected.

        Of a sine of the given amplitude [V] at frequencies (F,) [Hz]; what must stay
        under the amplifier's current limit.
        """
        angular = 2.0 * np.pi * frequency
        susceptance = angular * self.capacitance[:, None]
        return (
            amplitude * susceptance / np.hypot(1.0, susceptance * self.series_resistance[:, None])
        )


def time_constant_from_phase(phase: FloatArray, frequency: float) -> FloatArray:
    r"""R_S C [s] from the phase [rad] by which the amplifier's current leads its voltage.

    arctan(1 / (R_S C omega)) = phase, (15), leakage neglected.
    """
    return 1.0 / (2.0 * np.pi * frequency * np.tan(phase))


def time_constant_interval(
    phase: float, resolution: float, frequency: float
) -> tuple[float, float]:
    """The R_S C [s] that a phase [rad] rounded to `resolution` allows, by (15).

    Close to pi/2 the tangent is steep: 1.56 rad at 10 Hz, rounded to 0.01 rad, allows
    0.92e-4 to 2.51e-4 s, which is why a posterior of the circuit replaces this figure.
    A phase that may have been pi/2 or more leaves 0 as the lower end.
    """
    ends = np.array([phase + 0.5 * resolution, phase - 0.5 * resolution])
    least, most = time_constant_from_phase(ends, frequency)
    return float(max(least, 0.0)), float(most)
