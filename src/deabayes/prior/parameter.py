"""A model parameter: its name, unit, support and default prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from deabayes.prior.distributions import Distribution


@dataclass(frozen=True)
class Parameter:
    """A named unknown of a model, in SI units.

    Attributes
    ----------
    name : as in summaries, config entries and draws (`mu_alpha`, `tau_beta_1`).
    symbol : the paper's symbol as matplotlib mathtext, without dollar signs (`\\mu_\\alpha`).
    unit : SI unit in pint's notation (`Pa`, `s`, `1`).
    prior : default prior.
    source : where the default prior comes from.
    ordered : name of the group whose members ascend with a minimum ratio or
        distance (`tau_beta`); members of one group share one prior.
    ordered_from : the end that the data determine best, from which the group's sampling
        coordinates are built; the prior is the same either way.
    half_product_with : name of another parameter; the prior is then that of half the
        product of the two, which is positive (Ogden: mu_i alpha_i / 2, the term's share
        of the shear modulus).
    reference_stretches : with `half_product_with`, the largest and the smallest principal
        stretch lambda_1, lambda_3 of a reference state; the prior is then that of
        mu_i (lambda_1^alpha_i - lambda_3^alpha_i), the term's stress there.
    part_of : name of a total that the members make up; their common prior is then that of
        the total, its fractions are uniform on the simplex.
    belongs_to : name of the ordered parameter whose unit it is part of; it goes along when
        units are numbered anew (E_1 belongs to tau_1).
    """

    name: str
    symbol: str
    unit: str
    description: str
    prior: Distribution
    source: str
    ordered: str | None = None
    ordered_from: Literal["smallest", "largest"] = "smallest"
    half_product_with: str | None = None
    reference_stretches: tuple[float, float] | None = None
    part_of: str | None = None
    belongs_to: str | None = None

    @property
    def is_time_constant(self) -> bool:
        """Whether it is that of a relaxation unit, of which there may be several."""
        return self.unit == "s" and self.ordered is not None
