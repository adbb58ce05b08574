"""Candidates of the membrane: their names, parameters and priors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

from deabayes.experiment import FloatArray
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Draws
from deabayes.systems.spring_candidates import (
    count,
    kv_gm_examples,
    kv_gm_parameters,
    unit_draws,
    unknown,
)

INERTIA = "_inertia"
MODULUS = (
    LogNormal(25e3, 0.8),
    "VHB 4910: long-term modulus 13.7-35 kPa, branches 10-65 kPa (Hossain et al. 2012; Wang et "
    "al. 2016; Nguyen et al. 2021); 5-95 % is 6.7 to 93 kPa",
)
VISCOSITY = (
    LogNormal(5e4, 1.5),
    "Nguyen et al. 2021: eta_alpha = 150 and 200 N s/m at H = 1 mm are 75 and 100 kPa s; below, "
    "10-50 kPa x 0.1 s of relaxation faster than the units; 5-95 % is 4.2 to 590 kPa s",
)
TIME = (
    LogUniform(1.0, 5000.0),
    "relaxation times 1.5 tau of 1.5 to 7500 s at pre-stretch 3, from the time of dashpot alpha "
    "to creep that is all but straight over a 600 s record; Nguyen et al. 2021: 6/50/125 s "
    "(step) and 69/97.5/450 s (alternating); VHB 4910 elsewhere 0.6-500 s",
)


@dataclass(frozen=True)
class MembraneModel:
    """The KV-GM model with `units` Maxwell units, and with inertia if `inertia` is True."""

    units: int
    inertia: bool

    @classmethod
    def from_name(cls, candidate: str) -> Self:
        """Parse `kv_gm_<n>` or `kv_gm_<n>_inertia`."""
        match = re.fullmatch(rf"kv_gm_(\d+)({INERTIA})?", candidate)
        if not match:
            raise unknown(candidate, "membrane", kv_gm_examples())
        return cls(count(match[1], candidate, "units"), match[2] is not None)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters in the order of interface.md."""
        return kv_gm_parameters(
            self.units,
            MODULUS,
            VISCOSITY,
            TIME,
        )

    def unit_draws(self, draws: Draws) -> tuple[FloatArray, FloatArray]:
        """Return the moduli mu_beta and the times tau_beta, each (W, n)."""
        return unit_draws(draws, ("mu_beta", "tau_beta"), self.units)
