"""Candidates of the tensile strip: parameters, derived quantities, the material as a solid."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Derived, Draws
from deabayes.systems.membrane.material import DASHPOT, LIMITS
from deabayes.systems.solid import FINITE_STRAIN, Note, Solid, coefficients, no_relaxation
from deabayes.systems.spring_candidates import (
    count,
    kv_gm_examples,
    kv_gm_parameters,
    modulus_parameters,
    read_spring,
    spring_examples,
    time_parameters,
    unit_draws,
)
from deabayes.systems.springs import REGISTRY as SPRINGS
from deabayes.systems.springs import Spring
from deabayes.systems.springs.base import MODULUS_MEDIAN

VHB_MODULUS = (
    LogNormal(30e3, 1.2),
    "VHB 4910: long-term modulus 13.7-35 kPa, branches 11-56 kPa (Hossain et al. 2012; Wang et "
    "al. 2016; Nguyen et al. 2021); 5-95 % is 4 to 216 kPa",
)
VISCOSITY = (
    LogNormal(1e4, 2.0),
    "stands for relaxation faster than the units: modulus 10-50 kPa x 0.1-1 s = 1-50 kPa s; "
    "Nguyen et al. 2021 print 1e5 Pa s; 5-95 % is 0.37 to 270 kPa s",
)
TIME = (
    LogUniform(0.1, 5000.0),
    "from the sampling interval of tensile tests to the length of long relaxations; VHB 4910: "
    "0.6-0.8, 6.6-11 and 61-500 s",
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
            return cls(SPRINGS["gent"], 1, count(match[1], candidate, "units"), True)
        name = read_spring(candidate, "tensile_strip", examples())
        return cls(name.spring, name.terms, name.units, False)

    @property
    def order(self) -> int:
        """Number of relaxation units, or of spring terms if there are no units."""
        return self.units or self.terms

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters in the order of interface.md."""
        if self.kelvin:
            return kv_gm_parameters(self.units, VHB_MODULUS, VISCOSITY, TIME)
        alone = SPRINGS["neo_hookean"].parameters(1, MODULUS_MEDIAN)[0]
        return (
            *self.spring.parameters(self.terms, MODULUS_MEDIAN),
            *modulus_parameters(self.units, (alone.prior, alone.source), "tau"),
            *time_parameters(self.units, TIME, "tau", r"\tau_{{{i}}}"),
        )

    def spring_draws(self, draws: Draws) -> Draws:
        """Return the draws with the parameter names of the spring law."""
        return {"mu": draws["mu_alpha"], "J": draws["J_alpha"]} if self.kelvin else draws

    def unit_draws(self, draws: Draws) -> tuple[FloatArray, FloatArray]:
        """Return the moduli mu_beta and the times tau, each (W, n)."""
        return unit_draws(draws, ("mu_beta", "tau_beta" if self.kelvin else "tau"), self.units)

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
        total = long_term + moduli.sum(axis=1)
        found["shear_modulus_total"] = Derived(
            r"\mu_\mathrm{total}", "Pa", "shear modulus of spring alpha and all units", total
        )
        for i, (modulus, time) in enumerate(zip(moduli.T, times.T, strict=True), start=1):
            found[f"relaxation_time_{i}"] = Derived(
                rf"\tau_{{{i}}}(\lambda={REFERENCE_STRETCH:g})", "s",
                f"relaxation time of unit {i} held at stretch {REFERENCE_STRETCH:g}, linearised",
                time * REFERENCE_STRETCH**2 / 3.0,
            )  # fmt: skip
            found[f"zeta_beta_{i}"] = Derived(
                rf"\zeta_{{\beta {i}}}", "Pa s", f"viscosity of unit {i}", modulus * time
            )
        return found


def examples() -> list[str]:
    """Return the candidates with up to four terms and units."""
    return kv_gm_examples() + spring_examples(SPRINGS.values())


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
    unit_moduli, times = model.unit_draws(draws)
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
