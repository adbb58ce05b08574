"""Candidates with springs and Maxwell units: how their names are read, and their parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError, nearest
from deabayes.prior.distributions import Distribution
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Draws, UnknownCandidate
from deabayes.systems.springs import REGISTRY as SPRINGS
from deabayes.systems.springs import Spring
from deabayes.systems.springs.gent import limit_parameter

MAXIMUM = 6
"""Largest number of relaxation units, and of spring terms."""
SEVERAL = range(1, 5)
"""Numbers of terms and units in examples of candidates."""
PriorAndSource = tuple[Distribution, str]


@dataclass(frozen=True)
class SpringName:
    """What the name `<spring>[_<terms>][_units_<n>[<ending>]]` of a candidate says."""

    spring: Spring
    terms: int
    units: int
    ending: str


def unknown(candidate: str, system: str, examples: Sequence[str]) -> UnknownCandidate:
    """Return the error for a candidate that a system does not have."""
    return UnknownCandidate(
        f"unknown candidate {candidate!r} of system {system!r}{nearest(candidate, examples)}"
    )


def count(digits: str, candidate: str, what: str) -> int:
    """Parse a number of units or terms; it must be 1 to MAXIMUM."""
    number = int(digits)
    if not 1 <= number <= MAXIMUM:
        raise UserError(f"candidate {candidate!r}: {what} must be 1 to {MAXIMUM}, not {number}")
    return number


def read_spring(
    candidate: str, system: str, examples: Sequence[str], ending: str = ""
) -> SpringName:
    """Parse `<spring>[_<terms>][_units_<n>[<ending>]]`."""
    match = re.fullmatch(rf"([a-z_]+?)(?:_(\d+))?(?:_units_(\d+)({ending})?)?", candidate)
    if not match or match[1] not in SPRINGS:
        raise unknown(candidate, system, examples)
    spring = SPRINGS[match[1]]
    if spring.counts_terms != (match[2] is not None):
        remedy = "needs" if spring.counts_terms else "takes no"
        raise UserError(f"candidate {candidate!r}: spring {spring.name} {remedy} terms")
    terms = count(match[2] or "1", candidate, "terms")
    units = count(match[3], candidate, "units") if match[3] else 0
    return SpringName(spring, terms, units, match[4] or "")


def spring_examples(springs: Iterable[Spring]) -> list[str]:
    """Return the candidates of springs with up to four terms and units."""
    found = []
    for spring in springs:
        heads = [f"{spring.name}_{n}" for n in SEVERAL] if spring.counts_terms else [spring.name]
        found += heads
        found += [f"{head}_units_{n}" for head in heads for n in SEVERAL]
    return found


def kv_gm_examples() -> list[str]:
    """Return the KV-GM candidates with up to four units."""
    return [f"kv_gm_{n}" for n in SEVERAL]


def kv_gm_parameters(
    units: int, modulus: PriorAndSource, viscosity: PriorAndSource, time: PriorAndSource
) -> tuple[Parameter, ...]:
    """Return the parameters of KV-GM (Nguyen et al. 2021) in the order of interface.md."""
    return (
        Parameter("mu_alpha", r"\mu_\alpha", "Pa", "shear modulus of spring alpha", *modulus),
        Parameter("zeta_alpha", r"\zeta_\alpha", "Pa s", "viscosity of dashpot alpha", *viscosity),
        limit_parameter("J_alpha", r"J_\alpha"),
        *modulus_parameters(units, modulus, "tau_beta"),
        *time_parameters(units, time, "tau_beta", r"\tau_{{\beta {i}}}"),
        limit_parameter("J_beta", r"J_\beta"),
    )


def modulus_parameters(units: int, modulus: PriorAndSource, time: str) -> tuple[Parameter, ...]:
    """Return the shear moduli mu_beta of the units, which belong to the times named `time`."""
    what = "shear modulus of Maxwell unit {i}"
    return Parameter(
        "mu_beta_{i}", r"\mu_{{\beta {i}}}", "Pa", what, *modulus, belongs_to=time + "_{i}"
    ).numbered(units)


def time_parameters(
    units: int, time: PriorAndSource, name: str, symbol: str, over: str = "modulus"
) -> tuple[Parameter, ...]:
    """Return the times of the units, in ascending order."""
    what = f"viscosity over {over} of Maxwell unit {{i}}"
    return Parameter(name + "_{i}", symbol, "s", what, *time, ordered=name).numbered(units)


def unit_draws(draws: Draws, names: tuple[str, str], units: int) -> tuple[FloatArray, FloatArray]:
    """Return the draws of both parameters of the units, such as `mu_beta`, `tau`, each (W, n)."""
    first, second = (
        np.stack([draws[f"{name}_{i}"] for i in range(1, units + 1)], axis=1).astype(float)
        for name in names
    )
    return first, second
