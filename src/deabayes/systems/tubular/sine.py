"""The tubular actuator under a biased sine: circuit, Maxwell pressure, moving chain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.linear import hold
from deabayes.systems.curves import peak
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.voigt_kelvin import Chain, ComplexArray, MovingChain

AnyArray = ComplexArray | FloatArray


@dataclass(frozen=True)
class BiasedSine:
    """The voltage v_AMP = A sin(2 pi f t) + B [V] from t = 0; frequency f in Hz."""

    amplitude: float
    bias: float
    frequency: float

    @property
    def angular(self) -> float:
        """omega [rad/s]."""
        return 2.0 * np.pi * self.frequency


@dataclass(frozen=True)
class Series:
    """The sum Re sum_r c_r exp(s_r t): coefficients c and rates s [1/s], each (W, R)."""

    coefficients: ComplexArray
    rates: ComplexArray

    def lasting(self) -> Series:
        """Return the terms that do not decay."""
        kept = np.all(self.rates.real == 0.0, axis=0)
        return Series(self.coefficients[:, kept], self.rates[:, kept])

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the sum (W, N) at `time` (N,)."""
        terms = np.exp(self.rates[:, :, None] * time)
        return np.einsum("wr,wrn->wn", self.coefficients, terms).real


def charge_coefficients(
    circuit: Circuit, amplitude: float, bias: float, angular: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A_1, A_2, A_3, A_4 of (8), each (W, F), at the angular frequencies (F,)."""
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
    """Return v_C [V], (8)."""
    a_1, a_2, a_3, a_4 = _at(circuit, sine)
    omega, decay = 1j * sine.angular, -1.0 / circuit.time_constant
    return _series([(a_4, 0.0), (-a_2 - 1j * a_1, omega), (a_3, decay)])


def pressure_series(circuit: Circuit, sine: BiasedSine, per_square: FloatArray) -> Series:
    """Return sigma [Pa], (10)-(11); per_square is k (W,) [Pa/V^2]."""
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
    """Return beta_1 + i alpha_1 (W, F) [Pa], the steady pressure at the frequency f of v_AMP.

    The pressure alpha_1 cos(omega t) + beta_1 sin(omega t) is the imaginary part of
    (beta_1 + i alpha_1) exp(i omega t). Frequencies are (F,) or (W, F), in Hz. Without a circuit
    v_C is v_AMP, and the result is 2 k A B.
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
    """Build a series from pairs of a coefficient (W,) and a rate, (W,) or one for all draws."""
    walkers = len(terms[0][0])
    coefficients = np.stack([coefficient.astype(complex) for coefficient, _ in terms], axis=1)
    rates = [np.broadcast_to(np.asarray(rate, complex), walkers) for _, rate in terms]
    return Series(coefficients, np.stack(rates, axis=1))


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

    def per_volt(self, frequency: FloatArray) -> ComplexArray:
        """H(i omega) (beta_1 + i alpha_1) / A (W, F) [1/V], at frequencies (F,) or (W, F) [Hz].

        The modulus is the gain, the argument is the phase relative to the sine of v_AMP.
        """
        frequency = np.asarray(frequency, dtype=float)
        pressure = fundamental_pressure(
            self.circuit, 1.0, self.bias, frequency, self.pressure_per_square
        )
        rate = 2j * np.pi * frequency
        with np.errstate(all="ignore"):  # a draw that fails gives NaN
            if isinstance(self.chain, MovingChain):
                return np.asarray(pressure * self.chain.transfer(rate))
            return np.asarray(pressure * self.chain.complex_compliance(rate))

    def peak(self) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and gain [1/V] at the largest gain of a moving chain, (W,).

        Frequency is continuous here; the largest gain on a grid of frequencies is lower.
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
        """S (W, N) from rest at t = 0, shown by a sensor `sensor_delay` [s] later."""
        happened = np.maximum(np.asarray(time, dtype=float) - sensor_delay, 0.0)
        pressure = pressure_series(self.circuit, sine, self.pressure_per_square)
        return self._forced(pressure)(happened) + self._free(pressure, happened)

    def steady_strain(self, sine: BiasedSine, time: FloatArray) -> FloatArray:
        """Steady part of S (W, N): its mean and its terms with frequencies f and 2 f."""
        pressure = pressure_series(self.circuit, sine, self.pressure_per_square)
        return self._forced(pressure.lasting())(np.asarray(time, dtype=float))

    def harmonic(self, bias: float, frequency: FloatArray) -> ComplexArray:
        """Strain at frequency f per volt of amplitude (W, F) [1/V].

        The modulus is the gain, the argument is the phase relative to the sine of v_AMP. Without
        the bias [V] the pressure, a square, has no term at f.
        """
        return Harmonic(self.chain, self.circuit, self.pressure_per_square, bias).per_volt(
            frequency
        )

    def resonance(self, bias: float) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and gain [1/V] at the largest modulus of `harmonic`, each (W,)."""
        return Harmonic(self.chain, self.circuit, self.pressure_per_square, bias).peak()

    def _forced(self, pressure: Series) -> Series:
        gain = self.chain.transfer(pressure.rates)
        return Series(pressure.coefficients * gain, pressure.rates)

    def _free(self, pressure: Series, time: FloatArray) -> FloatArray:
        """Free motion (W, N); its sum with the forced motion starts from rest."""
        forced = self.chain.states(pressure.rates) * pressure.coefficients[:, None]
        start = -np.sum(forced, axis=2).real
        return self.chain.state_space().response(hold([0.0], [0.0], time), start)


def phase(harmonic: ComplexArray, frequency: FloatArray, sensor_delay: float = 0.0) -> FloatArray:
    """Phase (W, F) [rad] of a response that lags by less than a turn, shown by a sensor.

    Circuit and chain lag by up to 3/4 of a turn, so the argument is between -2 pi and 0. The
    sensor adds -omega times its delay [s], which has no bound.
    """
    argument = np.angle(harmonic)
    lag = np.where(argument > 0.0, argument - 2.0 * np.pi, argument)
    return lag - 2.0 * np.pi * frequency * sensor_delay
