"""Parameters and their standard normals before another posterior's correlations come in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from deabayes.distributions.scores import FloatArray
from deabayes.faults import UserError
from deabayes.parameter import Parameter
from deabayes.prior.blocks import blocks_of


class DefaultMap:
    r"""theta <-> z, N(0, I), of priors that are a config's or a system's own.

    Blocks of columns are transformed together (`Block`). A parameter x with `half_product_with`
    y carries its prior on x y / 2, or, where it has `reference_stretches` l, on the stress
    x (l_1^y - l_3^y): theta times a factor, 1 for most parameters.

    Parameters
    ----------
    parameters : in the order of theta's columns.
    groups : columns of the ordered ones, by the name of their group.
    minimum_ratios : between neighbours of ordered groups.

    Raises
    ------
    UserError : a half product whose prior reaches below 0.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        groups: Mapping[str, Sequence[int]],
        minimum_ratios: Mapping[str, float],
    ) -> None:
        self._parameters = parameters
        self._half_products = _half_products(parameters)
        self.blocks = blocks_of(parameters, groups, minimum_ratios)

    def to_parameters(self, z: FloatArray) -> FloatArray:
        """theta (W, d) of z (W, d)."""
        theta = np.empty_like(z, dtype=float)
        for block in self.blocks:
            theta[:, block.columns] = block.to_parameters(z[:, block.columns])
        with np.errstate(divide="ignore", over="ignore"):
            return theta / self._factors(theta)

    def to_normal(self, theta: FloatArray) -> FloatArray:
        """z (W, d) of theta (W, d); NaN where theta is outside the support."""
        theta = np.asarray(theta, dtype=float)
        theta = theta * self._factors(theta)
        z = np.empty_like(theta)
        for block in self.blocks:
            z[:, block.columns] = block.to_normal(theta[:, block.columns])
        return z

    def log_density(self, theta: FloatArray) -> FloatArray:
        """log p(theta), (W,), normalised; -inf or NaN outside the support."""
        factors = self._factors(theta)
        magnitudes = theta * factors
        with np.errstate(divide="ignore"):
            total = np.sum(np.log(np.abs(factors)), axis=1)
        for block in self.blocks:
            total += block.log_density(magnitudes[:, block.columns])
        return total

    def _factors(self, theta: FloatArray) -> FloatArray:
        """What theta (W, d) is multiplied by to carry the prior: 1 for most."""
        factors = np.ones_like(theta)
        for k, other in self._half_products:
            stretches = self._parameters[k].reference_stretches
            exponent = theta[:, other]
            if stretches is None:
                factors[:, k] = 0.5 * exponent
            else:
                first, third = np.log(stretches)
                factors[:, k] = np.expm1(first * exponent) - np.expm1(third * exponent)
        return factors


def _half_products(parameters: Sequence[Parameter]) -> list[tuple[int, int]]:
    """(parameter, parameter whose half product with it has the prior), as columns."""
    column = {parameter.name: k for k, parameter in enumerate(parameters)}
    found = []
    for k, parameter in enumerate(parameters):
        other = parameter.half_product_with
        if other is None:
            continue
        if other not in column:
            raise ValueError(f"{parameter.name}: half_product_with {other} is no parameter")
        if parameter.prior.support[0] < 0.0:
            raise UserError(
                f"prior of {parameter.name}: it is that of half of {parameter.name} {other}, "
                f"which is positive, so it must not reach below 0: {parameter.prior.describe()}"
            )
        found.append((k, column[other]))
    return found
