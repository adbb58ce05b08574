"""The simulated tubular actuator in frequency: harmonic balance, and an analyser's errors."""

from __future__ import annotations

import numpy as np
from data.make.sensor import Sensor, ornstein_uhlenbeck
from data.make.tubular_truth import Truth

from deabayes.experiment import FloatArray

RELATIVE_ERROR = 0.01
"""sd of the analyser's relative error, real (gain) and imaginary part (phase) alike."""
ERROR_LENGTH = 10.0
"""Frequency [Hz] over which that error is correlated."""
PERIODS = 20
"""Periods averaged at every frequency."""


def harmonic(truth: Truth, bias: float, frequency: float, load: float) -> complex:
    """Strain of frequency f per volt of v_AMP of that frequency [1/V], by harmonic balance.

    Steady v_C = V_0 + Im(V_1 exp(i omega t)) since the circuit is linear, so that v_C^2 has
    the term 2 V_0 V_1 at omega, whatever the amplitude. The states at omega (v_C, the
    voltages of the absorbing branches, S, S', the strains of the Kelvin units) solve one
    complex linear system.
    """
    series, leakage = truth.series_resistance, truth.leakage_resistance
    steady = bias * leakage / (leakage + series)
    branches, units = truth.branches(), len(truth.tau)
    s = 2 + len(branches)  # index of S'; S stands before it
    a = np.zeros((s + 1 + units, s + 1 + units))
    a[0, 0] = -(1.0 / series + 1.0 / leakage) / truth.capacitance
    for k, (resistance, constant) in enumerate(branches, start=1):
        a[0, 0] -= 1.0 / (resistance * truth.capacitance)
        a[0, k] = 1.0 / (resistance * truth.capacitance)
        a[k, 0], a[k, k] = 1.0 / constant, -1.0 / constant
    borne = np.zeros(a.shape[0])
    borne[s - 1], borne[s + 1 :] = truth.E[0], -truth.E[0]
    inertia = truth.inertia(load)
    a[s - 1, s] = 1.0
    a[s] = -borne / inertia
    a[s, 0] += 2.0 * steady * float(truth.pressure(1.0)) / inertia
    for n, (modulus, constant) in enumerate(zip(truth.E[1:], truth.tau, strict=True), s + 1):
        a[n] = borne / (modulus * constant)
        a[n, n] -= 1.0 / constant
    b = np.zeros(a.shape[0])
    b[0] = 1.0 / (series * truth.capacitance)
    omega = 2.0 * np.pi * frequency
    return complex(np.linalg.solve(1j * omega * np.eye(b.size) - a, b)[s - 1])


def measured(
    truth: Truth,
    sensor: Sensor,
    amplitude: float,
    bias: float,
    frequency: FloatArray,
    load: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Gain [1/V] and phase [rad], in (-pi, pi], as an analyser shows them, each (F,).

    The sensor's delay turns the phase. The analyser's relative error is smooth in
    frequency; the sensor's noise, averaged over PERIODS, comes on top.
    """
    exact = np.array([harmonic(truth, bias, f, load) for f in frequency.tolist()])
    delayed = exact * np.exp(-2j * np.pi * frequency * sensor.delay)
    smooth = [ornstein_uhlenbeck(frequency, ERROR_LENGTH, rng) for _ in range(2)]
    shown = delayed * (1.0 + RELATIVE_ERROR * (smooth[0] + 1j * smooth[1]))
    size = noise_per_volt(truth, sensor, amplitude, frequency)
    white = rng.standard_normal((2, frequency.size))
    shown = shown + size * (white[0] + 1j * white[1])
    return np.abs(shown), np.angle(shown)


def noise_per_volt(
    truth: Truth, sensor: Sensor, amplitude: float, frequency: FloatArray
) -> FloatArray:
    """sd (F,) of real and imaginary part [1/V] that the sensor's noise leaves.

    2 S(f) / T over T = PERIODS / f, with S the two-sided density of white noise sampled at
    10 kHz and of Ornstein-Uhlenbeck noise.
    """
    roll_off = 1.0 + (2.0 * np.pi * frequency * sensor.tau_ou) ** 2
    correlated = 2.0 * sensor.sigma_ou**2 * sensor.tau_ou / roll_off
    density = sensor.sigma_white**2 * 1e-4 + correlated
    noise = np.sqrt(2.0 * density * frequency / PERIODS)
    return np.asarray(noise / (truth.active_length * amplitude))
