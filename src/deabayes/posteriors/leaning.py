"""Parameters that the records push against a bound of their prior."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from deabayes.distributions import Distribution, LogUniform, Uniform
from deabayes.experiment import FloatArray
from deabayes.parameter import Parameter
from deabayes.prior.joint import Prior
from deabayes.quantities import with_unit

OUTERMOST, LEANS = 0.02, 0.25
"""Share of the prior next to its bound, and share of the draws in it, from which this is said."""
FURTHER = 10.0
"""Times what the bound is, in the line to write."""


def leaning(prior: Prior, theta: FloatArray) -> list[str]:
    """A sentence on every material parameter whose draws theta (W, d) lean on a bound.

    Where a quarter of them and more lie in the outermost 2 % of a prior with bounds, the records
    ask for values beyond, and everything else makes up for them.
    """
    inherited = {name for block in prior.inherited for name in block.names}
    return [
        sentence
        for parameter, draws in zip(prior.parameters, theta.T, strict=True)
        if "." not in parameter.name and parameter.name not in inherited
        for sentence in _of_parameter(parameter, draws)
    ]


def _of_parameter(parameter: Parameter, draws: FloatArray) -> Iterator[str]:
    from scipy.special import ndtr

    law = parameter.prior
    if not isinstance(law, LogUniform | Uniform):
        return
    passed = ndtr(law.to_normal(draws))
    ends = {"lower": passed < OUTERMOST, "upper": passed > 1.0 - OUTERMOST}
    for end, near in ends.items():
        share = float(np.mean(near))
        if share < LEANS:
            continue
        bound = with_unit(getattr(law, end), parameter.unit, parameter.name, digits=3)
        yield (
            f"{parameter.name}: {100 * share:.0f} % of its draws lie at the {end} bound of its "
            f"prior, {bound}: the records ask for values beyond, and other parameters make up for "
            f"it. In config.yaml: {_line(parameter, law, end)}"
        )


def _line(parameter: Parameter, law: Distribution, end: str) -> str:
    """The prior with this bound moved outwards, as config.yaml takes it."""
    bounds = {name: float(getattr(law, name)) for name in ("lower", "upper")}
    if isinstance(law, LogUniform):
        bounds[end] *= FURTHER if end == "upper" else 1.0 / FURTHER
    else:
        width = bounds["upper"] - bounds["lower"]
        bounds[end] += width if end == "upper" else -width
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    kind = "loguniform" if isinstance(law, LogUniform) else "uniform"
    said = ", ".join(f"{name}: {value:.4g}{unit}" for name, value in bounds.items())
    key = parameter.ordered or parameter.part_of or parameter.name
    return f"`priors: {{{key}: {{distribution: {kind}, {said}}}}}`"
