"""A model parameter: its name, unit, support and default prior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from deabayes.prior.distributions import Distribution


@dataclass(frozen=True)
class Parameter:
    """A named unknown of a model, in SI units.

    Attributes
    ----------
    name : name in summaries, config entries and draws (`mu_alpha`, `tau_beta_1`).
    symbol : the paper's symbol as matplotlib mathtext, without dollar signs (`\\mu_\\alpha`).
    unit : SI unit in pint's notation (`Pa`, `s`, `1`).
    prior : default prior.
    source : where the default prior comes from.
    ordered : name of the group whose members ascend with a minimum ratio or
        distance (`tau_beta`); members of one group share one prior.
    ordered_from : the end that the data determine best. The group's sampling coordinates are
        built from this end; the prior does not depend on it.
    half_product_with : name of another parameter; the prior is then on half the product of
        the two, which is positive (Ogden: mu_i alpha_i / 2, the term's share of the shear
        modulus).
    reference_stretches : with `half_product_with`, the largest and the smallest principal
        stretch lambda_1, lambda_3 of a reference state; the prior is then on
        mu_i (lambda_1^alpha_i - lambda_3^alpha_i), the term's stress in that state.
    part_of : name of a total of several parameters; their common prior is then the prior of
        the total, and their fractions of the total are uniform on the simplex.
    belongs_to : name of the ordered parameter of the same relaxation unit; both move together
        when units are renumbered (E_1 belongs to tau_1).
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

    def numbered(self, count: int) -> tuple[Parameter, ...]:
        """Return parameters 1 to `count`; the number replaces `{i}` in names, symbol and text."""
        return tuple(
            replace(
                self,
                name=self.name.format(i=i),
                symbol=self.symbol.format(i=i),
                description=self.description.format(i=i),
                half_product_with=self.half_product_with and self.half_product_with.format(i=i),
                belongs_to=self.belongs_to and self.belongs_to.format(i=i),
            )
            for i in range(1, count + 1)
        )

    @property
    def is_time_constant(self) -> bool:
        """Whether the parameter is a relaxation time, a member of an ordered group."""
        return self.unit == "s" and self.ordered is not None
