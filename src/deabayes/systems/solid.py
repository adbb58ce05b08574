"""A candidate as a solid for finite element programs, and as a linear model for control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.state_space import StateSpace
from deabayes.prior.parameter import Parameter
from deabayes.systems.springs import REGISTRY as SPRINGS

LINEAR = "linear_elastic"
"""The only law that is not in `springs`: Young's modulus `E` and Poisson's ratio `nu`."""
FINITE_STRAIN = (
    "Finite-strain relaxation in programs of finite elements multiplies the stress of one law by a "
    "function of time; in the model each unit's spring and dashpot multiply their stretches. The "
    "two agree for small strains of the undeformed solid, not away from it"
)


@dataclass(frozen=True)
class Note:
    """A sentence about the solid; `values` (W,) fill the braces in its text, one per draw."""

    text: str
    values: Mapping[str, FloatArray] = field(default_factory=dict)

    def of(self, k: int) -> str:
        """Return the sentence with the values of draw k."""
        return self.text.format(**{name: float(values[k]) for name, values in self.values.items()})


@dataclass(frozen=True)
class Solid:
    """An isotropic, (nearly) incompressible solid for every draw, in SI units.

    G(t) = G_0 (1 - sum_i g_i (1 - exp(-t/tau_i))), G_0 the instantaneous shear modulus.

    Attributes
    ----------
    law : name of a spring in `springs.REGISTRY`, or `linear_elastic`.
    moduli, others : coefficients of the law in Pa, and in other units, name -> (W,).
    instantaneous : whether the moduli hold before relaxation (True) or after it (False).
    shares, times : g_i and tau_i [s] of the shear modulus, (W, n); n is 0 without relaxation.
    density : [kg/m^3] (W,); None if not known.
    invariant : I_1 - 3 of the state in which the specimen works (W,); None if not known.
    notes : properties of the model that the material card does not contain, or only in part.
    """

    law: str
    moduli: Mapping[str, FloatArray]
    others: Mapping[str, FloatArray]
    instantaneous: bool
    shares: FloatArray
    times: FloatArray
    density: FloatArray | None = None
    invariant: FloatArray | None = None
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        if self.law == LINEAR and not self.instantaneous:
            # The bulk modulus does not relax, so E does not relax in proportion to G.
            raise ValueError(f"moduli of {LINEAR} must be instantaneous")

    @property
    def relaxed(self) -> FloatArray:
        """Ratio of long-term to instantaneous shear modulus, 1 - sum g_i, (W,)."""
        return np.asarray(1.0 - self.shares.sum(axis=1))

    @property
    def shear_moduli(self) -> tuple[FloatArray, FloatArray]:
        """Instantaneous and long-term small-strain shear modulus [Pa], each (W,)."""
        known = {**self.moduli, **self.others}
        if self.law == LINEAR:
            given = known["E"] / (2.0 * (1.0 + known["nu"]))
        else:
            given = np.asarray(SPRINGS[self.law].shear_modulus(known), dtype=float)
        if self.instantaneous:
            return given, given * self.relaxed
        return given / self.relaxed, given

    @property
    def instantaneous_moduli(self) -> Mapping[str, FloatArray]:
        """The law's coefficients in Pa before relaxation, name -> (W,)."""
        if self.instantaneous:
            return self.moduli
        return {name: values / self.relaxed for name, values in self.moduli.items()}


def coefficients(
    parameters: Sequence[Parameter], draws: Mapping[str, FloatArray]
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return a spring's coefficients from the draws: those in Pa, and those in other units."""
    units = {parameter.name: parameter.unit for parameter in parameters}
    found = {name: np.asarray(draws[name], dtype=float) for name in units}
    return (
        {name: values for name, values in found.items() if units[name] == "Pa"},
        {name: values for name, values in found.items() if units[name] != "Pa"},
    )


def no_relaxation(like: FloatArray) -> FloatArray:
    """Return the empty shares or times of a solid that does not relax, (W, 0)."""
    return np.empty((like.size, 0))


@dataclass(frozen=True)
class Signal:
    """An input, an output or a state of a linear model."""

    name: str
    unit: str
    description: str


@dataclass(frozen=True)
class At:
    """A value of the operating point, (W,), or () if it is the same for all draws."""

    unit: str
    description: str
    values: FloatArray


@dataclass(frozen=True)
class LinearModel:
    """A linear model x' = A x + B u, y = C x + D u for every draw.

    Attributes
    ----------
    space : the matrices, (W, ...).
    input, output, states : signals u, y and x, in the order of the matrices.
    validity : conditions under which the equations hold.
    operating_point : values from which u, x and y of a linearised model are deviations. Empty if
        the model is linear without a bias.
    """

    space: StateSpace
    input: Signal
    output: Signal
    states: tuple[Signal, ...]
    validity: str
    operating_point: Mapping[str, At]
