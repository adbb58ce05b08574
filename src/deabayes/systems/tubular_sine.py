r"""The whole tubular actuator under a biased sine: circuit, Maxwell pressure, moving chain.

In time: every exponential c exp(s t) of the pressure series forces the strain
c H(s) exp(s t), H = 1 / (1/D* + M s^2); starting from rest adds the free motion of the
state space from minus what these terms are at t = 0. No mode has to be told from another,
so repeated poles are no special case.

In frequency: the term of frequency f of the strain, the one that the paper's frequency
responses show, is H(i omega) (beta_1 + i alpha_1) against the sine of v_AMP. A candidate
without circuit, or without mass, has that term too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.linear import hold
from deabayes.systems.biased_sine import BiasedSine, Series, fundamental_pressure, pressure_series
from deabayes.systems.circuit import Circuit
from deabayes.systems.peak import peak
from deabayes.systems.voigt_kelvin import Chain, ComplexArray
from deabayes.systems.voigt_kelvin_inertia import MovingChain


@dataclass(frozen=True)
class Harmonic:
    """The strain's term of frequency f under v_AMP = A sin(2 pi f t) + B, per volt of A.

    Draws of the chain, of the circuit where there is one, and of k (W,); B [V]. The term is
    in proportion to the amplitude; the bias is what makes the pressure, a square, follow it.
    """

    chain: Chain | MovingChain
    circuit: Circuit | None
    pressure_per_square: FloatArray
    bias: float

    def per_volt(self, frequency: FloatArray) -> ComplexArray:
        """H(i omega) (beta_1 + i alpha_1) / A (W, F) [1/V], at frequencies (F,) or (W, F) [Hz].

        Its modulus is the gain, its argument the phase against the sine of v_AMP.
        """
        frequency = np.asarray(frequency, dtype=float)
        pressure = fundamental_pressure(
            self.circuit, 1.0, self.bias, frequency, self.pressure_per_square
        )
        rate = 2j * np.pi * frequency
        with np.errstate(all="ignore"):  # a draw that fails is NaN, and counted
            if isinstance(self.chain, MovingChain):
                return np.asarray(pressure * self.chain.transfer(rate))
            return np.asarray(pressure * self.chain.complex_compliance(rate))

    def peak(self) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and gain [1/V] where the gain of a moving chain is greatest, (W,).

        The peak is the continuous one; that of a grid of frequencies lies lower.
        """
        if not isinstance(self.chain, MovingChain):
            raise TypeError("a chain without mass has no resonance")
        stiffness = 1.0 / self.chain.chain.instantaneous
        highest = np.sqrt(stiffness / self.chain.inertia) / (2.0 * np.pi)
        return peak(lambda frequency: np.abs(self.per_volt(frequency)), highest)


@dataclass(frozen=True)
class SineResponse:
    """Draws of the actuator: its circuit, its chain and k = epsilon_0 epsilon_r / d^2 (W,)."""

    circuit: Circuit
    chain: MovingChain
    pressure_per_square: FloatArray

    def strain(self, sine: BiasedSine, time: FloatArray, sensor_delay: float = 0.0) -> FloatArray:
        """S (W, N) from rest at t = 0, as a sensor shows it `sensor_delay` [s] later."""
        happened = np.maximum(np.asarray(time, dtype=float) - sensor_delay, 0.0)
        pressure = pressure_series(self.circuit, sine, self.pressure_per_square)
        return self._forced(pressure)(happened) + self._free(pressure, happened)

    def steady_strain(self, sine: BiasedSine, time: FloatArray) -> FloatArray:
        """What remains of S (W, N): its mean and its terms of f and 2 f."""
        pressure = pressure_series(self.circuit, sine, self.pressure_per_square)
        return self._forced(pressure.lasting())(np.asarray(time, dtype=float))

    def harmonic(self, bias: float, frequency: FloatArray) -> ComplexArray:
        """Term of frequency f of the strain per volt of amplitude (W, F) [1/V].

        Its modulus is the gain, its argument the phase against the sine of v_AMP. The
        bias [V] is what makes the pressure, a square, follow the sine.
        """
        return Harmonic(self.chain, self.circuit, self.pressure_per_square, bias).per_volt(
            frequency
        )

    def resonance(self, bias: float) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and gain [1/V] of the peak of `harmonic`'s modulus, each (W,)."""
        return Harmonic(self.chain, self.circuit, self.pressure_per_square, bias).peak()

    def _forced(self, pressure: Series) -> Series:
        gain = self.chain.transfer(pressure.rates)
        return Series(pressure.coefficients * gain, pressure.rates)

    def _free(self, pressure: Series, time: FloatArray) -> FloatArray:
        """The motion (W, N) that makes the forced one start from rest."""
        forced = self.chain.states(pressure.rates) * pressure.coefficients[:, None]
        start = -np.sum(forced, axis=2).real
        return self.chain.state_space().response(hold([0.0], [0.0], time), start)


def phase(harmonic: ComplexArray, frequency: FloatArray, sensor_delay: float = 0.0) -> FloatArray:
    """Phase (W, F) [rad] of a response that lags by less than a turn, as a sensor shows it.

    Circuit and chain lag by up to 3/4 of a turn, so the argument is taken between
    -2 pi and 0; the sensor adds -omega times its delay [s] without end.
    """
    argument = np.angle(harmonic)
    lag = np.where(argument > 0.0, argument - 2.0 * np.pi, argument)
    return lag - 2.0 * np.pi * frequency * sensor_delay
