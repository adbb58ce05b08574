"""Candidates of the minimum-energy structure: parameters, priors, quantities."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

from deabayes.experiment import FloatArray, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.parameter import Parameter
from deabayes.systems.base import Draws
from deabayes.systems.spring_candidates import (
    read_spring,
    spring_examples,
    time_parameters,
    unit_draws,
)
from deabayes.systems.springs import REGISTRY as SPRINGS
from deabayes.systems.springs import Spring
from deabayes.systems.springs.base import MODULUS_MEDIAN

DRY = "_dry"
PAPER = "minimum-energy structure (2019)"
PERMITTIVITY = (
    LogNormal(3.0, 0.6),
    f"effective value: {PAPER}, Table 3, 1.704; bulk VHB 4.6-4.8; 5-95 % is 1.1 to 8",
)
STRESS = (
    LogNormal(1e6, 1.0),
    f"true stress of the film at rest: {PAPER}, Table 3, makes 1.3 MPa at 45 degrees; "
    "5-95 % is 0.19 to 5.2 MPa",
)
STIFFNESS = (
    LogNormal(5.0, 2.0),
    f"{PAPER}, Table 4: 0.8-66 N/m; 5-95 % is 0.19 to 134 N/m",
)
TIME = (
    LogUniform(1e-3, 500.0),
    f"{PAPER}, Table 4: 8.3 ms to 62.5 s; from the sampling interval to ten times 50 s of record",
)
VISCOUS = (
    LogNormal(0.1, 1.5),
    f"{PAPER}, Table 4: 0.1 N s/m; 5-95 % is 8.5e-3 to 1.2 N s/m",
)
FRICTION = (
    LogNormal(1e-3, 1.5),
    "stand-in: a hundredth of the blocking force of 0.15 N at 5 kV; 5-95 % is 0.085 to 12 mN",
)


@dataclass(frozen=True)
class StructureModel:
    """A film with `spring` of `terms` terms, `units` Maxwell units, and friction.

    Attributes
    ----------
    dry : whether friction at the slider is dry (F_c) or viscous (eta_0). Without units there is
        no friction and no motion in time.
    """

    spring: Spring
    terms: int
    units: int
    dry: bool

    @classmethod
    def from_name(cls, candidate: str) -> Self:
        """Parse `<spring>[_<terms>][_units_<n>[_dry]]`."""
        name = read_spring(candidate, "minimum_energy_structure", examples(), DRY)
        return cls(name.spring, name.terms, name.units, name.ending == DRY)

    @property
    def order(self) -> int:
        """Number of relaxation units, or of spring terms if there are no units."""
        return self.units or self.terms

    def parameters(
        self, permittivity_known: bool, stretches: tuple[float, float]
    ) -> tuple[Parameter, ...]:
        """Return the material parameters in the order of interface.md.

        Parameters
        ----------
        permittivity_known : whether the specimen states the relative permittivity. Then it is not
            a material parameter.
        stretches : lambda_x and lambda_z at the rest angle. For a spring that is a series, the
            prior is on the film's stress there, of which the terms are parts.
        """
        permittivity = Parameter(
            "relative_permittivity", r"\varepsilon_r", "1", "effective relative permittivity",
            *PERMITTIVITY,
        )  # fmt: skip
        prior, source = STRESS
        film = tuple(
            replace(p, prior=prior, source=source, reference_stretches=stretches,
                    part_of="film_stress")
            if p.half_product_with else p
            for p in self.spring.parameters(self.terms, MODULUS_MEDIAN)
        )  # fmt: skip
        return (*film, *(() if permittivity_known else (permittivity,)), *self._dissipative())

    def _dissipative(self) -> tuple[Parameter, ...]:
        if self.units == 0:
            return ()
        stiffness = Parameter("k_{i}", "k_{i}", "N/m", "stiffness of Maxwell unit {i}",
                              *STIFFNESS, belongs_to="tau_{i}")  # fmt: skip
        times = time_parameters(self.units, TIME, "tau", r"\tau_{i}", "stiffness")
        viscous = Parameter("eta_0", r"\eta_0", "N s/m", "viscous friction at the slider", *VISCOUS)
        dry = Parameter("friction_force", "F_c", "N", "dry friction at the slider", *FRICTION)
        return (*stiffness.numbered(self.units), *times, dry if self.dry else viscous)

    def unit_draws(self, draws: Draws) -> tuple[FloatArray, FloatArray]:
        """Return the stiffnesses k_i and the times tau_i, each (W, n)."""
        return unit_draws(draws, ("k", "tau"), self.units)


def examples() -> list[str]:
    """Return the candidates with up to four terms and units; springs that are a series first."""
    return spring_examples(sorted(SPRINGS.values(), key=lambda law: not law.counts_terms))


FRAME = {
    "youngs_modulus": "Pa",
    "frame_thickness": "m",
    "frame_width": "m",
    "cutout_radius": "m",
    "hinge_length": "m",
}
"""Quantity of the frame, needed for K = E (W - 2r) t^3/(12 s) -> SI unit."""


def measured_hinge(specimen: Specimen) -> Quantity | None:
    """Return the hinges' stiffness K with its sd, measured or computed from the frame, or None.

    Raises
    ------
    UserError
        If K has no sd, if a dimension of the frame is missing, or if K is both measured and
        computed. The sd is needed because the rest angle and the film also give a value of K.
    """
    given = specimen.quantities
    frame = [name for name in FRAME if name in given]
    if "hinge_stiffness" in given and frame:
        raise UserError(
            f"specimen {specimen.name!r} gives hinge_stiffness and {frame[0]}: the hinges' "
            "stiffness follows from either; remove one from quantities in specimen.yaml"
        )
    if frame and len(frame) < len(FRAME):
        missing = ", ".join(name for name in FRAME if name not in given)
        raise UserError(
            f"specimen {specimen.name!r}: the hinges' stiffness follows from the frame's "
            f"dimensions only with all of them; add {missing} to quantities in specimen.yaml"
        )
    found = _of_frame(specimen) if frame else given.get("hinge_stiffness")
    if found is not None and not (found.sd is not None and found.sd > 0.0):
        raise UserError(
            f"specimen {specimen.name!r}: the hinges' stiffness needs an sd, because it also "
            "follows from the rest angle and the film; give hinge_stiffness (or what it follows "
            "from) an sd in specimen.yaml, or leave it out"
        )
    return found


def _of_frame(specimen: Specimen) -> Quantity:
    """Compute K = E (W - 2r) t^3/(12 s), (13) of the paper, and its sd to first order."""
    modulus, thickness, width, radius, length = (specimen.quantities[name] for name in FRAME)
    net = width.value - 2.0 * radius.value
    if not net > 0.0:
        raise UserError(
            f"specimen {specimen.name!r}: frame_width must exceed twice cutout_radius; found "
            f"{width.value:g} and {radius.value:g} m"
        )
    value = modulus.value * net * thickness.value**3 / (12.0 * length.value)
    shares = (
        (modulus.sd or 0.0) / modulus.value,
        3.0 * (thickness.sd or 0.0) / thickness.value,
        (width.sd or 0.0) / net,
        2.0 * (radius.sd or 0.0) / net,
        (length.sd or 0.0) / length.value,
    )
    return Quantity(value, "N*m/rad", value * math.hypot(*shares), "from the frame's dimensions")


REQUIRED = {
    "link_length": "m",
    "mass_centre": "m",
    "link_mass": "kg",
    "slider_mass": "kg",
    "rotational_inertia": "kg*m^2",
    "film_thickness": "m",
    "prestretch": "1",
    "window_area": "m^2",
    "rest_angle": "rad",
}
"""Required quantity -> SI unit."""
OPTIONAL = {
    "relative_permittivity": "1",
    "gravity": "m/s^2",
    "hinge_stiffness": "N*m/rad",
    **FRAME,
}
UNCERTAIN = {
    "relative_permittivity": (
        r"\varepsilon_r",
        "relative permittivity of the film; fitted where it is not given",
    ),
    "rest_angle": (r"\theta_0", "angle of a link to the line between the ends, without a voltage"),
    "window_area": ("A_0", "area of the film in the frame, flat and stretched"),
    "film_thickness": ("t_0", "thickness of the film as it is stretched in the flat frame"),
    "prestretch": (r"\lambda_p", "stretch of the film in the flat frame, the same both ways"),
    "link_length": ("L", "length of one of the two links"),
    "mass_centre": ("l_m", "distance of a link's mass centre from its outer end"),
    "link_mass": ("m_1", "mass of one link"),
    "slider_mass": ("m_2", "mass of what moves along the line between the ends"),
    "rotational_inertia": ("J", "rotational inertia of one link about its mass centre"),
}
"""Quantity that is a parameter if it has an sd -> symbol and meaning."""
MEANINGS = {
    "force": "on what holds the slider, outwards positive: blocking force under a voltage",
    "displacement": "of the slider since rest, outwards positive",
    "gravity": "0 for a structure that lies on its side; 9.80665 m/s^2 where it is left out",
    "hinge_stiffness": "of one hinge, measured; needs an sd (else it follows from the rest angle)",
    "youngs_modulus": "Young's modulus of the frame",
    **{name: meaning for name, (_, meaning) in UNCERTAIN.items()},
}
