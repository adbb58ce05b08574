"""The coordinate in which specimens of one material are normally distributed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.parameter import Parameter

OF_LOGARITHM = "of the logarithm, about a relative one"
"""Text in the description of a spread that is about a percentage."""


@dataclass(frozen=True)
class Coordinate:
    """phi = log theta for a positive parameter, phi = theta for one that can change its sign.

    A spread of 0.1 of the logarithm is about 10 %, whatever the unit, and no specimen gets a
    negative value.
    """

    parameters: tuple[Parameter, ...]
    logarithmic: tuple[bool, ...]

    @classmethod
    def of(cls, parameters: Sequence[Parameter]) -> Coordinate:
        by_name = {p.name: p for p in parameters}
        return cls(tuple(parameters), tuple(is_positive(p, by_name) for p in parameters))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def spread_units(self) -> tuple[str, ...]:
        """Units of the standard deviations between specimens, by parameter."""
        pairs = zip(self.parameters, self.logarithmic, strict=True)
        return tuple("1" if logarithmic else p.unit for p, logarithmic in pairs)

    def forward(self, theta: FloatArray) -> FloatArray:
        """Return phi for theta (W, d)."""
        columns = np.asarray(self.logarithmic)
        phi = np.array(theta, dtype=float)
        phi[:, columns] = np.log(phi[:, columns])
        return phi

    def inverse(self, phi: FloatArray) -> FloatArray:
        """Return theta for phi (W, d)."""
        columns = np.asarray(self.logarithmic)
        theta = np.array(phi, dtype=float)
        theta[:, columns] = np.exp(theta[:, columns])
        return theta

    def log_derivative(self, theta: FloatArray) -> FloatArray:
        """log |d theta / d phi|, (W,), which turns a log density of theta into one of phi."""
        return np.asarray(np.log(theta[:, np.asarray(self.logarithmic)]).sum(axis=1))


def is_positive(parameter: Parameter, others: dict[str, Parameter]) -> bool:
    """Whether a parameter is positive; with a prior on a product, the other factor must be too."""
    other = parameter.half_product_with
    positive = parameter.prior.support[0] >= 0.0
    return positive and (other is None or is_positive(others[other], others))
