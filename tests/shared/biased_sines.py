"""Closed forms of the tubular actuator under a biased sine, (8)-(11) of Sarban et al. (2012)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.voigt_kelvin import MovingChain


@dataclass(frozen=True)
class BiasedSine:
    """The voltage v_AMP = A sin(2 pi f t) + B [V] from t = 0; frequency f in Hz."""

    amplitude: float
    bias: float
    frequency: float

    @property
    def angular(self):
        return 2.0 * np.pi * self.frequency

    def __call__(self, time):
        return self.amplitude * np.sin(self.angular * time) + self.bias


@dataclass(frozen=True)
class SineResponse:
    """Draws of the actuator: its circuit, its chain and k = epsilon_0 epsilon_r / d^2 (W,)."""

    circuit: Circuit
    chain: MovingChain
    pressure_per_square: np.ndarray

    def charge(self, sine):
        """Coefficients c and rates s (W, 4) of v_C = sum c exp(s t), (8)."""
        gain, tau = self.circuit.gain, self.circuit.time_constant
        swing = gain * sine.amplitude / (2j * (1.0 + 1j * sine.angular * tau))
        steady = gain * sine.bias
        zero, omega = np.zeros_like(gain), np.full_like(gain, sine.angular)
        return (
            np.stack([steady, swing, swing.conj(), -steady - 2.0 * swing.real], axis=1),
            np.stack([zero, 1j * omega, -1j * omega, -1.0 / tau], axis=1),
        )

    def strain(self, sine, time, sensor_delay=0.0, lasting=False):
        """S (W, N) from rest at t = 0, shown `sensor_delay` [s] later; or its `lasting` part."""
        happened = np.maximum(time - sensor_delay, 0.0)
        c, s = self.charge(sine)
        pairs = (len(c), -1)
        c = self.pressure_per_square[:, None] * (c[:, :, None] * c[:, None]).reshape(pairs)
        s = (s[:, :, None] + s[:, None]).reshape(pairs)
        c = np.where(s.real == 0.0, c, 0.0) if lasting else c
        space = self.chain.state_space()
        resolvent = s[:, :, None, None] * np.eye(space.b.shape[1]) - space.a[:, None]
        states = c[:, :, None] * np.linalg.solve(resolvent, space.b[:, None, :, None])[..., 0]
        forced = np.einsum("wr,wrn->wn", states[:, :, 0], np.exp(s[:, :, None] * happened)).real
        if lasting:
            return forced
        free = expm(space.a[:, None] * happened[:, None, None])[:, :, 0]
        return forced - np.einsum("wnk,wk->wn", free, states.sum(axis=1).real)
