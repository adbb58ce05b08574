"""Ogden spring: a series of powers of the principal stretches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.distributions import LogNormal, Uniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.springs.base import MODULUS_MEDIAN, PrincipalStretches, Spring, column

SHARE_SIGMA = 2.0
SHARE_SOURCE = (
    "prior of mu_i alpha_i / 2, the term's share of the shear modulus: 3 to 410 kPa in Ogden's "
    "(1972) fit of Treloar's rubber, 6 to 105 kPa in the minimum-energy structure's (2019, Table 3)"
)
EXPONENT_BOUNDS = (-5.0, 10.0)
EXPONENT_SOURCE = (
    "published exponents lie between -2 and 5 (Ogden 1972) and 0.24 and 3.3 (minimum-energy "
    "structure 2019, Table 3); bounds leave room on both sides"
)


def count_terms(draws: Mapping[str, FloatArray]) -> int:
    """Count the terms in `draws`: the largest N for which `draws` has `alpha_1`..`alpha_N`."""
    terms = 0
    while f"alpha_{terms + 1}" in draws:
        terms += 1
    return terms


def stress_of_one(
    exponent: FloatArray, log_first: FloatArray | float, log_third: FloatArray | float
) -> FloatArray:
    """Return sigma_1 / mu = lambda_1^alpha - lambda_3^alpha of one term."""
    return np.asarray(np.expm1(exponent * log_first) - np.expm1(exponent * log_third))


class Ogden(Spring):
    """W = sum_i (mu_i/alpha_i) (lambda_1^alpha_i + lambda_2^alpha_i + lambda_3^alpha_i - 3).

    Convention of the minimum-energy-structure paper (2019): the small-strain shear
    modulus is (1/2) sum_i mu_i alpha_i, and mu_i alpha_i > 0.
    """

    name = "ogden"
    counts_terms = True

    def parameters(
        self, terms: int = 1, modulus_median: float = MODULUS_MEDIAN
    ) -> tuple[Parameter, ...]:
        """Return `mu_1..N` [Pa] (mu_i alpha_i > 0), then `alpha_1..N`, which ascend."""
        coefficient = Parameter(
            name="mu_{i}",
            symbol=r"\mu_{i}",
            unit="Pa",
            description="coefficient of Ogden term {i}",
            prior=LogNormal(modulus_median, SHARE_SIGMA),
            source=SHARE_SOURCE,
            half_product_with="alpha_{i}",
        )
        exponent = Parameter(
            name="alpha_{i}",
            symbol=r"\alpha_{i}",
            unit="1",
            description="exponent of Ogden term {i}",
            prior=Uniform(*EXPONENT_BOUNDS),
            source=EXPONENT_SOURCE,
            ordered="alpha",
            ordered_from="largest",
        )
        return coefficient.numbered(terms) + exponent.numbered(terms)

    def cauchy_stress(
        self, stretches: PrincipalStretches, draws: Mapping[str, FloatArray]
    ) -> FloatArray:
        """sigma_1 = sum_i mu_i (lambda_1^alpha_i - lambda_3^alpha_i) [Pa], (W, N)."""
        log_first, log_third = np.log(stretches.first), np.log(stretches.third)
        stress = np.zeros(np.broadcast_shapes(column(draws["mu_1"]).shape, log_first.shape))
        for i in range(1, count_terms(draws) + 1):
            exponent = column(draws[f"alpha_{i}"])
            powers = stress_of_one(exponent, log_first, log_third)
            stress += column(draws[f"mu_{i}"]) * powers
        return stress

    def shear_modulus(self, draws: Mapping[str, FloatArray]) -> FloatArray:
        """(1/2) sum_i mu_i alpha_i [Pa], (W,)."""
        modulus = np.zeros_like(draws["mu_1"], dtype=np.float64)
        for i in range(1, count_terms(draws) + 1):
            modulus += 0.5 * draws[f"mu_{i}"] * draws[f"alpha_{i}"]
        return modulus
