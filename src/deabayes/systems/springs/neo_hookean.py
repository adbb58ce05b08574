"""Neo-Hookean spring: W = (mu/2) (I1 - 3)."""

from __future__ import annotations

from collections.abc import Mapping

from deabayes.experiment import FloatArray
from deabayes.prior.distributions import LogNormal
from deabayes.prior.parameter import Parameter
from deabayes.systems.springs.base import (
    MODULUS_MEDIAN,
    MODULUS_SIGMA,
    MODULUS_SOURCE,
    PrincipalStretches,
    Spring,
    column,
)


def modulus_parameter(modulus_median: float) -> Parameter:
    """Return the parameter `mu`, a shear modulus, with its default prior."""
    return Parameter(
        name="mu",
        symbol=r"\mu",
        unit="Pa",
        description="shear modulus",
        prior=LogNormal(modulus_median, MODULUS_SIGMA),
        source=MODULUS_SOURCE,
    )


class NeoHookean(Spring):
    """W = (mu/2) (lambda_1^2 + lambda_2^2 + lambda_3^2 - 3)."""

    name = "neo_hookean"

    def parameters(
        self, terms: int = 1, modulus_median: float = MODULUS_MEDIAN
    ) -> tuple[Parameter, ...]:
        """Return the parameter `mu` [Pa]; `terms` is ignored."""
        return (modulus_parameter(modulus_median),)

    def cauchy_stress(
        self, stretches: PrincipalStretches, draws: Mapping[str, FloatArray]
    ) -> FloatArray:
        """sigma_1 = mu (lambda_1^2 - lambda_3^2) [Pa], (W, N)."""
        return column(draws["mu"]) * (stretches.first**2 - stretches.third**2)

    def shear_modulus(self, draws: Mapping[str, FloatArray]) -> FloatArray:
        """mu [Pa], (W,)."""
        return draws["mu"]
