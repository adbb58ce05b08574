"""Base class of the spring laws, which compute stress from stretches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.prior.parameter import Parameter

MODULUS_MEDIAN = 50e3
"""Default prior median of a shear modulus [Pa] when the material is not known."""
MODULUS_SIGMA = 1.5
"""Log-normal sigma of the default prior: 5-95 % is 4 kPa to 0.6 MPa, VHB 4910 to filled rubber."""
MODULUS_SOURCE = (
    "wide, to hold VHB 4910 (13.7-35 kPa long-term; Hossain et al. 2012, Wang et al. 2016), "
    "soft silicones and natural rubber (0.4 MPa, Treloar 1944)"
)


class PrincipalStretches(NamedTuple):
    """Stretches of an incompressible sheet; direction 3, its thickness, is free of stress."""

    first: FloatArray
    second: FloatArray
    third: FloatArray


def principal_stretches(stretch: FloatArray, deformation: str) -> PrincipalStretches:
    """Principal stretches of an incompressible sheet pulled by `stretch` in direction 1.

    Parameters
    ----------
    stretch : any shape, positive.
    deformation : `uniaxial`, `equibiaxial` or `pure_shear`.

    Raises
    ------
    UserError
        If `deformation` is none of these.
    """
    stretch = np.asarray(stretch, dtype=float)
    if deformation == "uniaxial":
        lateral = 1.0 / np.sqrt(stretch)
        return PrincipalStretches(stretch, lateral, lateral)
    if deformation == "equibiaxial":
        return PrincipalStretches(stretch, stretch, stretch**-2)
    if deformation == "pure_shear":
        return PrincipalStretches(stretch, np.ones_like(stretch), 1.0 / stretch)
    raise unknown_deformation(deformation)


DEFORMATIONS = ("uniaxial", "equibiaxial", "pure_shear")
OTHER_NAMES = {
    "biaxial": "equibiaxial",
    "tension": "uniaxial",
    "planar": "pure_shear",
    "planartension": "pure_shear",
}


def unknown_deformation(name: str) -> UserError:
    """Return the error for an unknown deformation, with a hint for names that mean a known one."""
    plain = "".join(letter for letter in name.lower() if letter.isalpha())
    written = {each.replace("_", ""): each for each in DEFORMATIONS} | OTHER_NAMES
    usual = written.get(plain, "")
    known = ", ".join(DEFORMATIONS)
    hint = f"; did you mean {usual!r}?" if usual else f"; known: {known} (simple shear is none)"
    return UserError(f"unknown deformation {name!r}{hint}")


def column(values: FloatArray) -> FloatArray:
    """Return draws (W,) as (W, 1), to broadcast against points (N,)."""
    return np.asarray(values, dtype=float)[..., np.newaxis]


class Spring(ABC):
    """An incompressible hyperelastic law W(stretches; parameters).

    Attributes
    ----------
    name : registry name, and the first part of a candidate's name.
    counts_terms : whether the law is a series with a number of terms to choose.
    """

    name: ClassVar[str]
    counts_terms: ClassVar[bool] = False

    @abstractmethod
    def parameters(
        self, terms: int = 1, modulus_median: float = MODULUS_MEDIAN
    ) -> tuple[Parameter, ...]:
        """Return parameters with default priors; `modulus_median` [Pa] scales priors of moduli."""

    @abstractmethod
    def cauchy_stress(
        self, stretches: PrincipalStretches, draws: Mapping[str, FloatArray]
    ) -> FloatArray:
        """True stress in direction 1 [Pa]; direction 3 is free of stress.

        sigma_1 = lambda_1 dW/dlambda_1 - lambda_3 dW/dlambda_3. Stretches are (N,) or
        (W, N), draws (W,). Returns (W, N), with NaN where the law does not hold.
        """

    @abstractmethod
    def shear_modulus(self, draws: Mapping[str, FloatArray]) -> FloatArray:
        """Small-strain shear modulus [Pa], (W,)."""

    def inverse_limit(self, draws: Mapping[str, FloatArray]) -> FloatArray:
        """1/J for the limit J of I1 - 3, (W,); zero for a law without a limit.

        The stress of a law with a limit is divided by 1 - (I1 - 3)/J.
        """
        return np.zeros_like(self.shear_modulus(draws), dtype=np.float64)

    def without_limit(self, draws: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        """Return the draws with an infinite limit, if the law has one."""
        return draws

    def nominal_stress(
        self,
        stretch: FloatArray,
        draws: Mapping[str, FloatArray],
        deformation: str = "uniaxial",
    ) -> FloatArray:
        """Nominal stress P = sigma_1 / stretch [Pa] in the pulled direction, (W, N).

        Parameters
        ----------
        stretch : (N,), or (W, N) if each draw has its own.
        draws : the law's parameters, each (W,).
        deformation : `uniaxial`, `equibiaxial` or `pure_shear`.
        """
        stretch = np.asarray(stretch, dtype=float)
        return self.cauchy_stress(principal_stretches(stretch, deformation), draws) / stretch
