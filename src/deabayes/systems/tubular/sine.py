"""The harmonic response of the tubular actuator to a sine about a bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.systems.curves import peak
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.voigt_kelvin import Chain, ComplexArray, MovingChain


@dataclass(frozen=True)
class Harmonic:
    """The strain at frequency f per volt of A, under v_AMP = A sin(2 pi f t) + B.

    It has draws of the chain, of the circuit if there is one, and of k (W,), and the bias B [V].
    The strain at f is proportional to A and to B, because the pressure is a square.
    """

    chain: Chain | MovingChain
    circuit: Circuit | None
    pressure_per_square: FloatArray
    bias: float

    def pressure(self, frequency: FloatArray) -> ComplexArray:
        """Return (beta_1 + i alpha_1) / A (W, F) [Pa/V] of (11), at (F,) or (W, F) [Hz].

        The steady pressure at f, alpha_1 cos(omega t) + beta_1 sin(omega t), is the imaginary part
        of (beta_1 + i alpha_1) exp(i omega t). Without a circuit v_C is v_AMP: 2 k A B.
        """
        steady = 2.0 * self.pressure_per_square * self.bias
        if self.circuit is None:
            shape = steady.size, frequency.shape[-1]
            return np.broadcast_to(steady[:, None], shape).astype(complex)
        # 2 k A_4 (A_1 - i A_2) = 2 k g^2 A B / (1 + i omega tau_e)
        steady = steady * self.circuit.gain**2
        lag = 2.0 * np.pi * frequency * self.circuit.time_constant[:, None]
        found = np.empty(lag.shape, dtype=complex)
        found.real = steady[:, None] / (1.0 + lag**2)
        found.imag = -lag * found.real
        return found

    def per_volt(self, frequency: FloatArray) -> ComplexArray:
        """H(i omega) (beta_1 + i alpha_1) / A (W, F) [1/V], at frequencies (F,) or (W, F) [Hz].

        The modulus is the gain, the argument is the phase relative to the sine of v_AMP.
        """
        frequency = np.asarray(frequency, dtype=float)
        rate = 2j * np.pi * frequency
        with np.errstate(all="ignore"):  # a draw that fails gives NaN
            if isinstance(self.chain, MovingChain):
                return np.asarray(self.pressure(frequency) * self.chain.transfer(rate))
            return np.asarray(self.pressure(frequency) * self.chain.complex_compliance(rate))

    def peak(self) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and gain [1/V] at the largest gain of a moving chain, (W,).

        Frequency is continuous here; the largest gain on a grid of frequencies is lower.
        """
        if not isinstance(self.chain, MovingChain):
            raise TypeError("a chain without mass has no resonance")
        stiffness = 1.0 / self.chain.chain.instantaneous
        highest = np.sqrt(stiffness / self.chain.inertia) / (2.0 * np.pi)
        return peak(lambda frequency: np.abs(self.per_volt(frequency)), highest)


def phase(harmonic: ComplexArray) -> FloatArray:
    """Phase [rad] of a response that lags by less than a turn.

    Circuit and chain lag by up to 3/4 of a turn, so the argument is between -2 pi and 0.
    """
    argument = np.angle(harmonic)
    return np.where(argument > 0.0, argument - 2.0 * np.pi, argument)
