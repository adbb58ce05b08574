r"""A biased sine switched on at t = 0: capacitor voltage and pressure as series.

v_AMP = A sin(omega t) + B for t >= 0 charges the circuit to (Sarban et al. 2012, (8))

v_C = A_1 sin(omega t) - A_2 cos(omega t) + A_3 exp(-t / tau_e) + A_4,

and sigma = k v_C^2 with k = epsilon_0 epsilon_r / d^2 has the series (10)-(11)

sigma = alpha_0 + alpha_1 cos(omega t) + beta_1 sin(omega t)
        + alpha_2 cos(2 omega t) + beta_2 sin(2 omega t)
        + (chi_1 cos(omega t) + delta_1 sin(omega t) + gamma_1) exp(-t / tau_e)
        + gamma_2 exp(-2 t / tau_e).

Printed (8) decays as exp(-tau_e t) and (10) as exp(-n tau_C t), whose exponents have a
dimension; the printed A_3 lacks a factor R_L in its first term, so that v_C(0) is not zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.systems.circuit import Circuit
from deabayes.systems.voigt_kelvin import ComplexArray

AnyArray = ComplexArray | FloatArray


@dataclass(frozen=True)
class BiasedSine:
    """v_AMP = A sin(2 pi f t) + B [V], from rest at t = 0; frequency f in Hz."""

    amplitude: float
    bias: float
    frequency: float

    @property
    def angular(self) -> float:
        """omega [rad/s]."""
        return 2.0 * np.pi * self.frequency


@dataclass(frozen=True)
class Series:
    """Re sum_r c_r exp(s_r t): coefficients c and rates s [1/s], each (W, R)."""

    coefficients: ComplexArray
    rates: ComplexArray

    def lasting(self) -> Series:
        """The terms that do not decay."""
        kept = np.all(self.rates.real == 0.0, axis=0)
        return Series(self.coefficients[:, kept], self.rates[:, kept])

    def __call__(self, time: FloatArray) -> FloatArray:
        """The sum (W, N) at `time` (N,)."""
        terms = np.exp(self.rates[:, :, None] * time)
        return np.einsum("wr,wrn->wn", self.coefficients, terms).real


def charge_coefficients(
    circuit: Circuit, amplitude: float, bias: float, angular: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A_1, A_2, A_3, A_4 of (8), each (W, F), at the angular frequencies (F,)."""
    series, leakage, capacitance = (
        values[:, None]
        for values in (circuit.series_resistance, circuit.leakage_resistance, circuit.capacitance)
    )
    total = leakage + series
    phi = (leakage * series * capacitance * angular) ** 2 + total**2
    sine = amplitude * leakage * total / phi
    cosine = amplitude * leakage**2 * series * capacitance * angular / phi
    steady = np.broadcast_to(leakage * bias / total, sine.shape)
    return sine, cosine, cosine - steady, steady


def charge_series(circuit: Circuit, sine: BiasedSine) -> Series:
    """v_C [V], (8)."""
    a_1, a_2, a_3, a_4 = _at(circuit, sine)
    omega, decay = 1j * sine.angular, -1.0 / circuit.time_constant
    return _series([(a_4, 0.0), (-a_2 - 1j * a_1, omega), (a_3, decay)])


def pressure_series(circuit: Circuit, sine: BiasedSine, per_square: FloatArray) -> Series:
    """sigma [Pa], (10)-(11); per_square is k (W,) [Pa/V^2]."""
    a_1, a_2, a_3, a_4 = _at(circuit, sine)
    omega, decay = 1j * sine.angular, -1.0 / circuit.time_constant
    alpha_0 = 0.5 * per_square * (a_1**2 + a_2**2 + 2.0 * a_4**2)
    alpha_1, beta_1 = -2.0 * per_square * a_2 * a_4, 2.0 * per_square * a_1 * a_4
    alpha_2, beta_2 = 0.5 * per_square * (a_2**2 - a_1**2), -per_square * a_1 * a_2
    chi_1, delta_1 = -2.0 * per_square * a_2 * a_3, 2.0 * per_square * a_1 * a_3
    gamma_1, gamma_2 = 2.0 * per_square * a_3 * a_4, per_square * a_3**2
    return _series(
        [
            (alpha_0, 0.0),
            (alpha_1 - 1j * beta_1, omega),
            (alpha_2 - 1j * beta_2, 2.0 * omega),
            (chi_1 - 1j * delta_1, decay + omega),
            (gamma_1, decay),
            (gamma_2, 2.0 * decay),
        ]
    )


def fundamental_pressure(
    circuit: Circuit | None,
    amplitude: float,
    bias: float,
    frequency: FloatArray,
    per_square: FloatArray,
) -> ComplexArray:
    """The steady term of frequency f against the sine of v_AMP, beta_1 + i alpha_1 (W, F) [Pa].

    alpha_1 cos(omega t) + beta_1 sin(omega t) is the imaginary part of it times
    exp(i omega t). Frequencies (F,), or (W, F), in Hz. Without circuit v_C is v_AMP, and the
    term is 2 k A B.
    """
    if circuit is None:
        in_phase = 2.0 * per_square[:, None] * amplitude * bias
        return np.broadcast_to(in_phase, (per_square.size, np.shape(frequency)[-1])).astype(complex)
    # 2 k A_4 (A_1 - i A_2) = 2 k g^2 A B / (1 + i omega tau_e)
    steady = 2.0 * per_square * circuit.gain**2 * amplitude * bias
    lag = 2.0 * np.pi * np.asarray(frequency) * circuit.time_constant[:, None]
    found = np.empty(lag.shape, dtype=complex)
    found.real = steady[:, None] / (1.0 + lag**2)
    found.imag = -lag * found.real
    return found


def _at(circuit: Circuit, sine: BiasedSine) -> list[FloatArray]:
    angular = np.array([sine.angular])
    found = charge_coefficients(circuit, sine.amplitude, sine.bias, angular)
    return [values[:, 0] for values in found]


def _series(terms: Sequence[tuple[AnyArray, AnyArray | complex]]) -> Series:
    """Of pairs of a coefficient (W,) and a rate, (W,) or one for all draws."""
    walkers = len(terms[0][0])
    coefficients = np.stack([coefficient.astype(complex) for coefficient, _ in terms], axis=1)
    rates = [np.broadcast_to(np.asarray(rate, complex), walkers) for _, rate in terms]
    return Series(coefficients, np.stack(rates, axis=1))
