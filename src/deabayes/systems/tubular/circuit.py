r"""The circuit between amplifier and electrodes (Sarban et al. 2012).

A series resistance R_S charges the capacitance C, and a leakage resistance R_L is parallel to C:

v_C' + v_C / tau_e = v_AMP / (R_S C),   tau_e = R_L R_S C / (R_L + R_S).     (4), (5)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.charged import charged_voltage
from deabayes.integrate.linear import Hold, hold, relaxation_response
from deabayes.integrate.modal import modal_response
from deabayes.integrate.state_space import StateSpace
from deabayes.systems.base import Derived


@dataclass(frozen=True)
class Supply:
    """An amplifier's voltage, prepared for `Circuit.supplied`.

    Attributes
    ----------
    coordinate : (N,) times at which the current is computed [s].
    voltage : (N,) voltage at these times [V]; at a jump, the value after the jump.
    slopes : slope of the voltage, constant between knots.
    jumps : time and size of each jump of the voltage; at the first knot it jumps from zero.
    """

    coordinate: FloatArray
    voltage: FloatArray
    slopes: Hold
    jumps: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, time: FloatArray, amplifier: FloatArray, coordinate: FloatArray) -> Supply:
        """Prepare a voltage that is linear between `time` (M,); a repeated time is a jump."""
        voltage = hold(time, amplifier, coordinate)
        slope = voltage.polynomials[:, 1] / voltage.lengths[voltage.length_index]
        none = np.zeros_like(slope)
        slopes = replace(
            voltage,
            polynomials=np.stack([slope, none, none], axis=1),
            input=np.zeros_like(voltage.input),
        )
        before = np.append(0.0, amplifier[:-1])
        at = np.append(True, np.diff(time) == 0.0) & (amplifier != before)
        sizes = (amplifier - before)[at]
        return cls(
            np.asarray(coordinate, dtype=float),
            voltage.input,
            slopes,
            tuple(zip(time[at].tolist(), sizes.tolist(), strict=True)),
        )


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
        """v_C / v_AMP under a steady voltage, R_L / (R_L + R_S), (W,)."""
        return self.leakage_resistance / (self.leakage_resistance + self.series_resistance)

    def charge(self, time: FloatArray, amplifier: FloatArray, coordinate: FloatArray) -> FloatArray:
        """Exact v_C (W, N) [V] for an amplifier voltage that is linear between `time` (M,).

        `coordinate` is (N,), or (W, N) if it differs between draws. The capacitance is not charged
        before the first time, where the voltage jumps to its first value.
        """
        own = np.broadcast_to(coordinate, (self.gain.size, coordinate.shape[-1]))
        return charged_voltage(time, amplifier, self.gain, 1.0 / self.time_constant, own)

    def drive(self, space: StateSpace, voltage: Hold) -> FloatArray:
        """Exact response (W, N) of linear systems to v_C^2, from rest.

        `voltage` holds v_AMP itself (power 1 of `hold`), not its square.
        """
        return modal_response(space, voltage, self.gain, 1.0 / self.time_constant)

    def supplied(self, supply: Supply) -> FloatArray:
        r"""Exact current of the amplifier, (v_AMP - v_C) / R_S (W, N) [A].

        Under a steady voltage v_AMP - v_C is a millionth of v_AMP. To avoid this small difference,
        with g = R_L / (R_L + R_S),

        i = v_AMP / (R_L + R_S) + g^2 C s,   tau_e s' = v_AMP' - s,

        from (4) and R_S i = v_AMP - v_C. A jump of v_AMP by J raises s by J / tau_e.
        """
        constant = np.where(self.time_constant > 0.0, self.time_constant, np.nan)[:, None]
        lagged = relaxation_response(
            supply.slopes, np.zeros_like(self.gain), np.ones_like(constant), constant
        )
        for at, size in supply.jumps:
            since = np.maximum(supply.coordinate - at, 0.0)
            left = size / constant * np.exp(-since / constant)
            lagged += np.where(supply.coordinate >= at, left, 0.0)
        leaking = supply.voltage / (self.leakage_resistance + self.series_resistance)[:, None]
        return leaking + (self.gain**2 * self.capacitance)[:, None] * lagged

    def current_amplitude(self, amplitude: float, frequency: FloatArray) -> FloatArray:
        r"""I = omega C V / sqrt(1 + (omega R_S C)^2) (W, F) [A], (16), without leakage.

        I is the current amplitude for a sine with amplitude V [V] at frequencies (F,) [Hz]. It
        must stay below the current limit of the amplifier.
        """
        angular = 2.0 * np.pi * frequency
        susceptance = angular * self.capacitance[:, None]
        return (
            amplitude * susceptance / np.hypot(1.0, susceptance * self.series_resistance[:, None])
        )

    def derived(self) -> dict[str, Derived]:
        """Return `electrical_time_constant` tau_e and `series_time_constant` R_S C of (15)."""
        return {
            "electrical_time_constant": Derived(
                r"\tau_e", "s", "time constant of the circuit", self.time_constant
            ),
            "series_time_constant": Derived(
                "R_S C",
                "s",
                "series resistance times capacitance",
                self.series_resistance * self.capacitance,
            ),
        }


def time_constant_from_phase(phase: FloatArray, frequency: float) -> FloatArray:
    r"""Compute R_S C [s] from the phase [rad] by which the amplifier's current leads its voltage.

    arctan(1 / (R_S C omega)) = phase, (15), without leakage. NaN for a phase above pi/2, which is
    not possible for any R_S C.
    """
    series = 1.0 / (2.0 * np.pi * frequency * np.tan(phase))
    return np.where(series >= 0.0, series, np.nan)


def time_constant_interval(
    phase: float, resolution: float, frequency: float
) -> tuple[float, float]:
    """Return the range of R_S C [s] for a phase [rad] rounded to `resolution`, by (15).

    Close to pi/2 the tangent is steep: 1.56 rad at 10 Hz, rounded to 0.01 rad, allows 0.92e-4 to
    2.51e-4 s. Therefore a posterior of the circuit replaces this value. If the phase before
    rounding can be above pi/2, the lower end is 0. If it must be above pi/2, the result is NaN.
    """
    ends = np.array([phase + 0.5 * resolution, phase - 0.5 * resolution])
    least, most = time_constant_from_phase(ends, frequency)
    lowest = 0.0 if np.isnan(least) and not np.isnan(most) else least
    return float(lowest), float(most)
