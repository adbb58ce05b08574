"""The scale on which specimens of one material scatter normally."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.parameter import Parameter

OF_LOGARITHM = "of the logarithm, about a relative one"
"""In the description of a spread that may be read as per cent."""


@dataclass(frozen=True)
class Coordinate:
    """phi = log theta of a positive parameter, theta itself of one that changes its sign.

    On the logarithm a spread of 0.1 is one of about 10 %, whatever the unit, and no specimen
    is negative.
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
        """Units of the standard deviations between specimens."""
        pairs = zip(self.parameters, self.logarithmic, strict=True)
        return tuple("1" if logarithmic else p.unit for p, logarithmic in pairs)

    def forward(self, theta: FloatArray) -> FloatArray:
        """phi of theta (W, d)."""
        columns = np.asarray(self.logarithmic)
        phi = np.array(theta, dtype=float)
        phi[:, columns] = np.log(phi[:, columns])
        return phi

    def inverse(self, phi: FloatArray) -> FloatArray:
        """theta of phi (W, d)."""
        columns = np.asarray(self.logarithmic)
        theta = np.array(phi, dtype=float)
        theta[:, columns] = np.exp(theta[:, columns])
        return theta

    def log_derivative(self, theta: FloatArray) -> FloatArray:
        """log |d theta / d phi|, (W,): what a density of theta gains as one of phi."""
        return np.asarray(np.log(theta[:, np.asarray(self.logarithmic)]).sum(axis=1))


def is_positive(parameter: Parameter, others: dict[str, Parameter]) -> bool:
    """Whether a parameter cannot be negative; a factor of a positive product can, if both can."""
    other = parameter.half_product_with
    positive = parameter.prior.support[0] >= 0.0
    return positive and (other is None or is_positive(others[other], others))
