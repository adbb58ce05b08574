"""Candidates of the tensile strip: parameters, derived quantities, the material as a solid."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError, nearest
from deabayes.prior.distributions import Distribution, LogNormal, LogUniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Derived, Draws, UnknownCandidate
from deabayes.systems.membrane.material import DASHPOT, LIMITS
from deabayes.systems.solid import FINITE_STRAIN, Note, Solid, coefficients, no_relaxation
from deabayes.systems.springs import REGISTRY as SPRINGS
from deabayes.systems.springs import Spring
from deabayes.systems.springs.base import MODULUS_MEDIAN
from deabayes.systems.springs.gent import limit_parameter

MAXIMUM = 6
"""Largest number of relaxation units, and of spring terms."""
VHB_MODULUS = LogNormal(30e3, 1.2)
VHB_SOURCE = (
    "VHB 4910: long-term modulus 13.7-35 kPa, branches 11-56 kPa (Hossain et al. 2012; Wang et "
    "al. 2016; Nguyen et al. 2021); 5-95 % is 4 to 216 kPa"
)
VISCOSITY = LogNormal(1e4, 2.0)
VISCOSITY_SOURCE = (
    "stands for relaxation faster than the units: modulus 10-50 kPa x 0.1-1 s = 1-50 kPa s; "
    "Nguyen et al. 2021 print 1e5 Pa s; 5-95 % is 0.37 to 270 kPa s"
)
TIME = LogUniform(0.1, 5000.0)
TIME_SOURCE = (
    "from the sampling interval of tensile tests to the length of long relaxations; VHB 4910: "
    "0.6-0.8, 6.6-11 and 61-500 s"
)
REFERENCE_STRETCH = 2.0
"""Stretch at which derived relaxation times are given."""


@dataclass(frozen=True)
class StripModel:
    """A spring alpha parallel to `units` Maxwell units, and to a dashpot alpha if `kelvin`.

    Attributes
    ----------
    kelvin : whether the model is KV-GM (Nguyen et al. 2021), where all springs are Gent springs.
        Otherwise the springs of the units are neo-Hookean and there is no dashpot alpha.
    """

    spring: Spring
    terms: int
    units: int
    kelvin: bool

    @classmethod
    def from_name(cls, candidate: str) -> Self:
        """Parse `kv_gm_<n>` or `<spring>[_<terms>][_units_<n>]`."""
        if match := re.fullmatch(r"kv_gm_(\d+)", candidate):
            return cls(SPRINGS["gent"], 1, _count(match[1], candidate, "units"), True)
        match = re.fullmatch(r"([a-z_]+?)(?:_(\d+))?(?:_units_(\d+))?", candidate)
        if not match or match[1] not in SPRINGS:
            raise UnknownCandidate(
                f"unknown candidate {candidate!r}{nearest(candidate, examples())}"
            )
        spring = SPRINGS[match[1]]
        if spring.counts_terms != (match[2] is not None):
            remedy = "needs" if spring.counts_terms else "takes no"
            raise UserError(f"candidate {candidate!r}: spring {spring.name} {remedy} terms")
        terms = _count(match[2] or "1", candidate, "terms")
        return cls(spring, terms, _count(match[3], candidate, "units") if match[3] else 0, False)

    @property
    def order(self) -> int:
        """Number of relaxation units, or of spring terms if there are no units."""
        return self.units or self.terms

    @property
    def time_group(self) -> str:
        """Name of the ordered relaxation times."""
        return "tau_beta" if self.kelvin else "tau"

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters in the order of interface.md."""
        if self.kelvin:
            spring: tuple[Parameter, ...] = (
                Parameter("mu_alpha", r"\mu_\alpha", "Pa", "shear modulus of spring alpha",
                          VHB_MODULUS, VHB_SOURCE),
                Parameter("zeta_alpha", r"\zeta_\alpha", "Pa s", "viscosity of dashpot alpha",
                          VISCOSITY, VISCOSITY_SOURCE),
                limit_parameter("J_alpha", r"J_\alpha"),
            )  # fmt: skip
        else:
            spring = self.spring.parameters(self.terms, MODULUS_MEDIAN)
        limit = (limit_parameter("J_beta", r"J_\beta"),) if self.kelvin else ()
        return spring + self._unit_parameters() + limit

    def _unit_parameters(self) -> tuple[Parameter, ...]:
        numbers = range(1, self.units + 1)
        if self.kelvin:
            prior: Distribution = VHB_MODULUS
            source = VHB_SOURCE
        else:
            alone = SPRINGS["neo_hookean"].parameters(1, MODULUS_MEDIAN)[0]
            prior, source = alone.prior, alone.source
        beta = r"\beta " if self.kelvin else ""
        moduli = tuple(
            Parameter(f"mu_beta_{i}", rf"\mu_{{\beta {i}}}", "Pa",
                      f"shear modulus of Maxwell unit {i}", prior, source,
                      belongs_to=f"{self.time_group}_{i}")
            for i in numbers
        )  # fmt: skip
        times = tuple(
            Parameter(f"{self.time_group}_{i}", rf"\tau_{{{beta}{i}}}", "s",
                      f"viscosity over modulus of Maxwell unit {i}", TIME, TIME_SOURCE,
                      ordered=self.time_group)
            for i in numbers
        )  # fmt: skip
        return moduli + times

    def spring_draws(self, draws: Draws) -> Draws:
        """Return the draws with the parameter names of the spring law."""
        return {"mu": draws["mu_alpha"], "J": draws["J_alpha"]} if self.kelvin else draws

    def unit_draws(self, draws: Draws) -> tuple[np.ndarray, np.ndarray]:
        """Return the moduli mu_beta and the times tau, each (n, W)."""
        numbers = range(1, self.units + 1)
        moduli = np.array([draws[f"mu_beta_{i}"] for i in numbers], dtype=float)
        times = np.array([draws[f"{self.time_group}_{i}"] for i in numbers], dtype=float)
        return moduli, times

    def derived(self, draws: Draws) -> dict[str, Derived]:
        """Return moduli, viscosities of dashpots and linearised relaxation times."""
        long_term = np.asarray(self.spring.shear_modulus(self.spring_draws(draws)), dtype=float)
        found = {
            "shear_modulus_long_term": Derived(
                r"\mu_\infty", "Pa", "long-term shear modulus", long_term
            )
        }
        if self.spring.counts_terms:
            found["mu_0"] = Derived(
                r"\mu_0", "Pa", "shear modulus of the spring, half of sum mu_i alpha_i", long_term
            )
        if self.units == 0:
            return found
        moduli, times = self.unit_draws(draws)
        total = long_term + moduli.sum(axis=0)
        found["shear_modulus_total"] = Derived(
            r"\mu_\mathrm{total}", "Pa", "shear modulus of spring alpha and all units", total
        )
        for i, (modulus, time) in enumerate(zip(moduli, times, strict=True), start=1):
            found[f"relaxation_time_{i}"] = Derived(
                rf"\tau_{{{i}}}(\lambda={REFERENCE_STRETCH:g})", "s",
                f"relaxation time of unit {i} held at stretch {REFERENCE_STRETCH:g}, linearised",
                time * REFERENCE_STRETCH**2 / 3.0,
            )  # fmt: skip
            found[f"zeta_beta_{i}"] = Derived(
                rf"\zeta_{{\beta {i}}}", "Pa s", f"viscosity of unit {i}", modulus * time
            )
        return found


def _count(digits: str, candidate: str, what: str) -> int:
    """Parse a number of units or terms; it must be 1 to MAXIMUM."""
    count = int(digits)
    if not 1 <= count <= MAXIMUM:
        raise UserError(f"candidate {candidate!r}: {what} must be 1 to {MAXIMUM}, not {count}")
    return count


def examples() -> list[str]:
    """Return the candidates with up to four terms and units."""
    found = [f"kv_gm_{n}" for n in range(1, 5)]
    for name, spring in SPRINGS.items():
        heads = [f"{name}_{terms}" for terms in range(1, 5)] if spring.counts_terms else [name]
        found += heads
        found += [f"{head}_units_{n}" for head in heads for n in range(1, 5)]
    return found


TIMES = (
    "Relaxation times are tau/3, those in uniaxial tension at stretch 1, linearised; at other "
    "stretches the model's go with the square of the stretch"
)
NEO_HOOKEAN_UNITS = (
    "Springs of the units are neo-Hookean, the spring beside them is not ({law}); the card scales "
    "one law, that spring's"
)
ELASTIC = "The candidate has no relaxation units: the card is elastic, and knows no time"


def solid(model: StripModel, draws: Draws) -> Solid:
    """Return the law of the spring parallel to the units, with their relaxation at stretch 1."""
    spring = model.spring_draws(draws)
    moduli, others = coefficients(model.spring.parameters(model.terms), spring)
    long_term = np.asarray(model.spring.shear_modulus(spring), dtype=float)
    if model.units == 0:
        none = no_relaxation(long_term)
        return Solid(model.spring.name, moduli, others, False, none, none, notes=(Note(ELASTIC),))
    unit_moduli, times = (values.T for values in model.unit_draws(draws))
    total = long_term + unit_moduli.sum(axis=1)
    return Solid(
        model.spring.name,
        moduli,
        others,
        False,
        unit_moduli / total[:, None],
        times / 3.0,
        notes=(Note(FINITE_STRAIN), Note(TIMES), *_of_model(model, draws, total)),
    )


def _of_model(model: StripModel, draws: Draws, total: FloatArray) -> tuple[Note, ...]:
    """Return notes on differences between the candidate's springs, and on dashpot alpha."""
    if model.kelvin:
        zeta = np.asarray(draws["zeta_alpha"], dtype=float)
        limits = {"beta": draws["J_beta"], "alpha": draws["J_alpha"]}
        dashpot = DASHPOT.replace("{state}", "stretch 1")
        return Note(dashpot, {"zeta": zeta, "time": zeta / (3.0 * total)}), Note(LIMITS, limits)
    if model.spring.name == "neo_hookean":
        return ()
    return (Note(NEO_HOOKEAN_UNITS.format(law=model.spring.name)),)
