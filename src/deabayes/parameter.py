"""A model parameter: its name, unit, support and default prior."""

from __future__ import annotations

from dataclasses import dataclass

from deabayes.distributions import Distribution


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
    sign_of : name of a parameter whose sign this one takes (Ogden: mu_i alpha_i > 0);
        the prior is then that of the absolute value.
    """

    name: str
    symbol: str
    unit: str
    description: str
    prior: Distribution
    source: str
    ordered: str | None = None
    sign_of: str | None = None
