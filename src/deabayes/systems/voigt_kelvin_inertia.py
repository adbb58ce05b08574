r"""The Voigt-Kelvin chain that moves a mass: state space and transfer function.

S(s) = sigma(s) / (1/D*(s) + M s^2),   D*(s) = 1/E_0 + sum_n 1 / (E_n (1 + tau_n s)),

Sarban et al. (2012): for K = 2 this is their ODE (2) with the coefficients (3). The
equivalent first-order equations hold for any number of units:

S'' = (sigma - q) / M,   q = E_0 (S - sum_n x_n),   x_n' = (q / E_n - x_n) / tau_n,

with q the stress that the chain bears and x_n the strain of Kelvin unit n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.state_space import StateSpace
from deabayes.systems.base import Derived
from deabayes.systems.peak import peak
from deabayes.systems.voigt_kelvin import Chain, ComplexArray


@dataclass(frozen=True)
class MovingChain:
    """Draws of a chain (moduli, times) and of its inertial parameter M (W,) [kg/m]."""

    chain: Chain
    inertia: FloatArray

    def state_space(self) -> StateSpace:
        """From pressure [Pa] to strain; states S [1], S' [1/s] and x_1..K [1].

        A draw with a time constant or a mass that is not positive has matrices of NaN.
        """
        walkers, units = self.chain.compliances.shape
        modulus = 1.0 / self.chain.instantaneous
        times = np.where(self.chain.time_constants > 0.0, self.chain.time_constants, np.nan)
        mass = np.where(self.inertia > 0.0, self.inertia, np.nan)
        flow = modulus[:, None] * self.chain.compliances / times
        a = np.zeros((walkers, units + 2, units + 2))
        a[:, 0, 1] = 1.0
        a[:, 1, 0] = -modulus / mass
        a[:, 1, 2:] = (modulus / mass)[:, None]
        a[:, 2:, 0] = flow
        a[:, 2:, 2:] = -flow[:, :, None]
        a[:, range(2, units + 2), range(2, units + 2)] -= 1.0 / times
        b, c = np.zeros((2, walkers, units + 2))
        b[:, 1] = 1.0 / mass
        c[:, 0] = 1.0
        return StateSpace(a, b, c, np.zeros(walkers))

    def transfer(self, rate: ComplexArray) -> ComplexArray:
        """Strain per pressure (W, R) [1/Pa] at the complex rates s (W, R) or (R,) [1/s]."""
        compliance = self.chain.complex_compliance(rate)
        return compliance / (1.0 + self.inertia[:, None] * rate**2 * compliance)

    def states(self, rate: ComplexArray) -> ComplexArray:
        """States (W, n, R) per pressure while all grows as exp(s t), s as above but -1/tau_n."""
        strain = self.transfer(rate)
        stress = strain / self.chain.complex_compliance(rate)
        units = self.chain.unit_compliances(rate) * stress[:, None]
        return np.concatenate([strain[:, None], (rate * strain)[:, None], units], axis=1)

    def resonance(self) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and height [1/Pa] of the peak of |S/sigma|, (W,).

        Zero frequency where no resonance rises above the compliance at rest. The
        peak lies below sqrt(E_0/M), since E_0 is the chain's greatest stiffness.
        """
        highest = np.sqrt(1.0 / (self.chain.instantaneous * self.inertia))
        angular, height = peak(lambda w: np.abs(self.transfer(1j * w)), highest)
        return angular / (2.0 * np.pi), height

    def derived(self) -> dict[str, Derived]:
        """`inertial_parameter` M [kg/m] and `resonance_frequency` [Hz] of strain to pressure."""
        return {
            "inertial_parameter": Derived("M", "kg/m", "inertial parameter", self.inertia),
            "resonance_frequency": Derived(
                "f_r", "Hz", "frequency of the greatest strain per pressure", self.resonance()[0]
            ),
        }
