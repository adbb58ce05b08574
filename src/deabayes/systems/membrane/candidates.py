"""Candidates of the membrane: their names, parameters and priors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError, nearest
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Draws, UnknownCandidate
from deabayes.systems.springs.gent import limit_parameter

MOST_UNITS = 6
INERTIA = "_inertia"
MODULUS = LogNormal(25e3, 0.8)
MODULUS_SOURCE = (
    "VHB 4910: long-term modulus 13.7-35 kPa, branches 10-65 kPa (Hossain et al. 2012; Wang et "
    "al. 2016; Nguyen et al. 2021); 5-95 % is 6.7 to 93 kPa"
)
VISCOSITY = LogNormal(5e4, 1.5)
VISCOSITY_SOURCE = (
    "Nguyen et al. 2021: eta_alpha = 150 and 200 N s/m at H = 1 mm are 75 and 100 kPa s; below, "
    "10-50 kPa x 0.1 s of relaxation faster than the units; 5-95 % is 4.2 to 590 kPa s"
)
TIME = LogUniform(1.0, 5000.0)
TIME_SOURCE = (
    "relaxation times 1.5 tau of 1.5 to 7500 s at pre-stretch 3, from the time of dashpot alpha "
    "to creep that is all but straight over a 600 s record; Nguyen et al. 2021: 6/50/125 s "
    "(step) and 69/97.5/450 s (alternating); VHB 4910 elsewhere 0.6-500 s"
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
            raise UnknownCandidate(
                f"unknown candidate {candidate!r} of system 'membrane'"
                f"{nearest(candidate, examples())}"
            )
        units = int(match[1])
        if not 1 <= units <= MOST_UNITS:
            raise UserError(
                f"candidate {candidate!r}: units must be 1 to {MOST_UNITS}, not {units}"
            )
        return cls(units, match[2] is not None)

    @property
    def numbers(self) -> range:
        """Numbers of the units, 1 to n."""
        return range(1, self.units + 1)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the material parameters in the order of interface.md."""
        return (
            Parameter("mu_alpha", r"\mu_\alpha", "Pa", "shear modulus of spring alpha",
                      MODULUS, MODULUS_SOURCE),
            Parameter("zeta_alpha", r"\zeta_\alpha", "Pa s", "viscosity of dashpot alpha",
                      VISCOSITY, VISCOSITY_SOURCE),
            limit_parameter("J_alpha", r"J_\alpha"),
            *(
                Parameter(f"mu_beta_{i}", rf"\mu_{{\beta {i}}}", "Pa",
                          f"shear modulus of Maxwell unit {i}", MODULUS, MODULUS_SOURCE,
                          belongs_to=f"tau_beta_{i}")
                for i in self.numbers
            ),
            *(
                Parameter(f"tau_beta_{i}", rf"\tau_{{\beta {i}}}", "s",
                          f"viscosity over modulus of Maxwell unit {i}", TIME, TIME_SOURCE,
                          ordered="tau_beta")
                for i in self.numbers
            ),
            limit_parameter("J_beta", r"J_\beta"),
        )  # fmt: skip

    def unit_draws(self, draws: Draws) -> tuple[FloatArray, FloatArray]:
        """Return the moduli mu_beta and the times tau_beta, each (W, n)."""
        moduli = np.stack([draws[f"mu_beta_{i}"] for i in self.numbers], axis=1)
        times = np.stack([draws[f"tau_beta_{i}"] for i in self.numbers], axis=1)
        return moduli.astype(float), times.astype(float)


def examples() -> list[str]:
    """Return the candidates with up to four units, without inertia."""
    return [f"kv_gm_{n}" for n in range(1, 5)]
