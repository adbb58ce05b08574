"""Gent spring: like neo-Hookean, with a limit of the first invariant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.distributions import LogNormal
from deabayes.prior.parameter import Parameter
from deabayes.systems.springs.base import MODULUS_MEDIAN, PrincipalStretches, Spring, column
from deabayes.systems.springs.neo_hookean import modulus_parameter

LIMIT_MEDIAN = 100.0
LIMIT_SIGMA = 0.7
LIMIT_SOURCE = (
    "wide about the values used for VHB 4910 (55-110) and rubber (Gent 1996: 30-100); "
    "5-95 % is 32 to 316: lock-up between stretch 5.8 and 17.8 uniaxially"
)


def limit_parameter(name: str = "J", symbol: str = "J") -> Parameter:
    """Return the parameter J, the limit of I1 - 3, with its default prior."""
    return Parameter(
        name=name,
        symbol=symbol,
        unit="1",
        description="Gent limit of the first invariant minus three",
        prior=LogNormal(LIMIT_MEDIAN, LIMIT_SIGMA),
        source=LIMIT_SOURCE,
    )


class Gent(Spring):
    """W = -(mu J/2) log(1 - (I1 - 3)/J), Gent, Rubber Chem. Technol. 69 (1996) 59."""

    name = "gent"

    def parameters(
        self, terms: int = 1, modulus_median: float = MODULUS_MEDIAN
    ) -> tuple[Parameter, ...]:
        """Return the parameters `mu` [Pa] and `J`; `terms` is ignored."""
        return (modulus_parameter(modulus_median), limit_parameter())

    def cauchy_stress(
        self, stretches: PrincipalStretches, draws: Mapping[str, FloatArray]
    ) -> FloatArray:
        """sigma_1 = mu (lambda_1^2 - lambda_3^2)/(1 - (I1 - 3)/J) [Pa], (W, N).

        NaN where the argument 1 - (I1 - 3)/J is not positive.
        """
        squares = [stretch**2 for stretch in stretches]
        argument = 1.0 - (squares[0] + squares[1] + squares[2] - 3.0) / column(draws["J"])
        argument[~(argument > 0.0)] = np.nan
        return column(draws["mu"]) * (squares[0] - squares[2]) / argument

    def shear_modulus(self, draws: Mapping[str, FloatArray]) -> FloatArray:
        """mu [Pa], (W,)."""
        return draws["mu"]

    def inverse_limit(self, draws: Mapping[str, FloatArray]) -> FloatArray:
        """1/J, (W,); NaN where J is not positive."""
        limit = np.asarray(draws["J"], dtype=float)
        return 1.0 / np.where(limit > 0.0, limit, np.nan)

    def without_limit(self, draws: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        """Return the draws with infinite J."""
        return {**draws, "J": np.full_like(draws["J"], np.inf, dtype=float)}
