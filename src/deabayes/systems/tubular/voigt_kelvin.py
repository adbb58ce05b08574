"""The Voigt-Kelvin chain: parameters, compliances, and a chain with mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.integrate.state_space import StateSpace
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Derived, Draws
from deabayes.systems.curves import peak

ComplexArray = NDArray[np.complexfloating[Any, Any]]
COMPLIANCE_TIMES = {"10ms": 0.01, "100ms": 0.1, "500ms": 0.5}


INSTANTANEOUS_MODULUS = Parameter(
    name="E_0",
    symbol="E_{0}",
    unit="Pa",
    description="instantaneous modulus",
    prior=LogNormal(2e6, 1.0),
    source="wide: silicone elastomers, 0.3 to 15 MPa with 95 %",
)
UNIT_MODULUS = Parameter(
    name="E_{i}",
    symbol="E_{{{i}}}",
    unit="Pa",
    description="modulus of Kelvin unit {i}",
    prior=LogNormal(1e7, 1.5),
    source="wide: a unit that strains from a hundredth to all of the instantaneous strain",
    belongs_to="tau_{i}",
)
TIME_CONSTANT = Parameter(
    name="tau_{i}",
    symbol=r"\tau_{{{i}}}",
    unit="s",
    description="retardation time of Kelvin unit {i}",
    prior=LogUniform(1e-3, 2.0),
    source=(
        "from the amplifier's charging time to four times the 0.5 s record of Sarban et al. 2012"
    ),
    ordered="tau",
)


def parameters(units: int) -> tuple[Parameter, ...]:
    """Return the parameters `E_0`, `E_1..K` [Pa] and, in ascending order, `tau_1..K` [s]."""
    return (INSTANTANEOUS_MODULUS, *UNIT_MODULUS.numbered(units), *TIME_CONSTANT.numbered(units))


@dataclass(frozen=True)
class Chain:
    """Draws of a chain: 1/E_0 (W,), 1/E_n (W, K) and tau_n (W, K)."""

    instantaneous: FloatArray
    compliances: FloatArray
    time_constants: FloatArray

    @classmethod
    def from_draws(cls, draws: Draws, units: int) -> Chain:
        """Read the chain's parameters; a modulus that is not positive becomes NaN."""
        moduli = np.column_stack([draws[f"E_{n}"] for n in range(units + 1)])
        times = np.column_stack([draws[f"tau_{n}"] for n in range(1, units + 1)])
        compliances = 1.0 / np.where(moduli > 0.0, moduli, np.nan)
        return cls(compliances[:, 0], compliances[:, 1:], times)

    def creep_compliance(self, time: float) -> FloatArray:
        """D(t) (W,) [1/Pa]; an infinite time gives the final compliance."""
        grown = -np.expm1(-time / self.time_constants)
        return self.instantaneous + np.sum(self.compliances * grown, axis=1)

    def relaxation(self) -> tuple[FloatArray, FloatArray]:
        r"""Return shares g_k of E_0 and times rho_k [s] of E(t), each (W, K), rho_k ascending.

        E(t) = E_0 (1 - sum_k g_k (1 - exp(-t/rho_k))) is the relaxation modulus, E*(s) D*(s) = 1.
        With a suitable scale of x, x_n' = -x_n/tau_n + (E_0/(E_n tau_n)) (S - sum_m x_m) has a
        symmetric matrix. With u_n = sqrt(E_0/(E_n tau_n)), the rates 1/rho_k are the eigenvalues
        of diag(1/tau) + u u^T, and g_k = rho_k (u . q_k)^2 with its eigenvectors q_k. NaN if a
        modulus or a time is not positive.
        """
        times = np.where(self.time_constants > 0.0, self.time_constants, np.nan)
        u = np.sqrt(self.compliances / (self.instantaneous[:, None] * times))
        matrix = np.eye(times.shape[1]) / times[:, None] + u[:, :, None] * u[:, None, :]
        lost = ~np.all(np.isfinite(matrix), axis=(1, 2))
        matrix[lost] = np.eye(times.shape[1])
        rates, vectors = np.linalg.eigh(matrix)
        shares = np.sum(u[:, :, None] * vectors, axis=1) ** 2 / rates
        shares[lost], rates[lost] = np.nan, np.nan
        return shares[:, ::-1], 1.0 / rates[:, ::-1]

    def state_space(self) -> StateSpace:
        """State space from pressure [Pa] to strain; states x_1..K [1], tau x' = -x + sigma/E.

        A draw with a time constant that is not positive has matrices of NaN.
        """
        units = self.compliances.shape[1]
        rates = 1.0 / np.where(self.time_constants > 0.0, self.time_constants, np.nan)
        return StateSpace(
            -rates[:, :, None] * np.eye(units),
            rates * self.compliances,
            np.ones_like(rates),
            self.instantaneous,
        )

    def complex_compliance(self, rate: ComplexArray) -> ComplexArray:
        """D*(s) = 1/E_0 + sum_n 1/(E_n (1 + tau_n s)) (W, R) [1/Pa], s (W, R) or (R,) [1/s]."""
        rate = np.atleast_2d(np.asarray(rate, dtype=complex))
        total = np.empty((self.instantaneous.size, rate.shape[1]), dtype=complex)
        _fill_compliance(self.instantaneous, self.compliances, self.time_constants, rate, total)
        return total

    def derived(self) -> dict[str, Derived]:
        """Return `compliance_*` at 10, 100 and 500 ms and final [1/Pa], and `eta_n` [Pa s]."""
        result = {
            f"compliance_{label}": Derived(
                rf"D({time:g}\,\mathrm{{s}})",
                "1/Pa",
                f"creep compliance {time:g} s after a step",
                self.creep_compliance(time),
            )
            for label, time in COMPLIANCE_TIMES.items()
        }
        result["compliance_total"] = Derived(
            r"D(\infty)", "1/Pa", "final creep compliance", self.creep_compliance(np.inf)
        )
        for n, viscosity in enumerate((self.time_constants / self.compliances).T, start=1):
            result[f"eta_{n}"] = Derived(
                rf"\eta_{{{n}}}", "Pa s", f"viscosity of Kelvin unit {n}", viscosity
            )
        return result


@njit(cache=True, error_model="numpy")
def _fill_compliance(instantaneous, compliances, times, rates, total) -> None:  # type: ignore[no-untyped-def]
    """Write D*(s) at the rates (W, R), or (1, R) for all draws, into `total` (W, R)."""
    own = rates.shape[0] > 1
    for w in range(total.shape[0]):
        for r in range(total.shape[1]):
            rate, real, imaginary = rates[w if own else 0, r], instantaneous[w], 0.0
            for n in range(times.shape[1]):
                x, y = 1.0 + times[w, n] * rate.real, times[w, n] * rate.imag
                share = compliances[w, n] / (x * x + y * y)
                real += share * x
                imaginary -= share * y
            total[w, r] = complex(real, imaginary)


@dataclass(frozen=True)
class MovingChain:
    """Draws of a chain (moduli, times) and of its inertial parameter M (W,) [kg/m]."""

    chain: Chain
    inertia: FloatArray

    def state_space(self) -> StateSpace:
        """State space from pressure [Pa] to strain; states S [1], S' [1/s] and x_1..K [1].

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

    def resonance(self) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and height [1/Pa] of the peak of |S/sigma|, (W,).

        The frequency is zero if no resonance is higher than the compliance at rest. The peak is
        below sqrt(E_0/M), because E_0 is the largest stiffness of the chain.
        """
        highest = np.sqrt(1.0 / (self.chain.instantaneous * self.inertia))
        angular, height = peak(lambda w: np.abs(self.transfer(1j * w)), highest)
        return angular / (2.0 * np.pi), height

    def derived(self) -> dict[str, Derived]:
        """Return `inertial_parameter` M [kg/m] and `resonance_frequency` [Hz]."""
        return {
            "inertial_parameter": Derived("M", "kg/m", "inertial parameter", self.inertia),
            "resonance_frequency": Derived(
                "f_r", "Hz", "frequency of the greatest strain per pressure", self.resonance()[0]
            ),
        }
