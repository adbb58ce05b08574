r"""The minimum-energy structure at rest: forces on the slider, the bent branch, constants.

See equations.md, section 3. With theta the links' angle, l = 2L cos theta, and the film's stress
at zero voltage sigma(theta) = sum_i mu_i (lambda_x^alpha_i - lambda_z^alpha_i), lambda_x =
lambda_p cos theta, lambda_z = 1/(lambda_p^2 cos theta), the generalised force on theta is

    A_0 t_0 sigma tan theta - 2 m_1 g l_m cos theta - 4 K theta - E sin theta cos theta U^2

with E = A_0 epsilon_0 epsilon_r/t_0. In equilibrium this force is zero, which gives U^2 as a
function of theta. The bent branch starts at the rest angle, where U = 0, and ends at the first
maximum of this function. Beyond it the structure snaps flat. The hinges' stiffness K follows from
the rest angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from deabayes.experiment import FloatArray, Specimen
from deabayes.systems.base import Draws
from deabayes.systems.electrostatics import VACUUM_PERMITTIVITY
from deabayes.systems.minimum_energy_structure.candidates import StructureModel
from deabayes.systems.specimen_quantities import filled, positive
from deabayes.systems.springs.base import PrincipalStretches, column

GRAVITY = 9.80665
FLATTEST = np.radians(3.0)
"""Below this angle the structure counts as flat: the equilibrium near 1 degree is unstable."""
STEEPER = np.radians(25.0)
STEEPEST = np.radians(80.0)
"""A motion may go up to STEEPER above the rest angle, but never beyond STEEPEST, 80 degrees."""
BRANCH_POINTS = 200
LOCK_UP = 0.995
"""End of the branch of a Gent film: this share of the way from rest to lock-up, in cos theta."""


@dataclass(frozen=True)
class Structure:
    """Constants of W draws in SI units, each (W,); NaN if a draw's value is not positive.

    Attributes
    ----------
    length : L; inertia, turning : M_0 and C of M = M_0 + C sin^2 theta; weight : 2 m_1 g l_m.
    rest : theta_0; section : A_0 t_0; prestretch : lambda_p; electric : E.
    hinge : 4 K, from equilibrium at the rest angle without voltage.
    """

    model: StructureModel
    draws: Draws
    length: FloatArray
    inertia: FloatArray
    turning: FloatArray
    weight: FloatArray
    rest: FloatArray
    section: FloatArray
    prestretch: FloatArray
    electric: FloatArray

    @classmethod
    def from_draws(cls, model: StructureModel, specimen: Specimen, draws: Draws) -> Self:
        """Compute the constants; a quantity that is not a parameter has the specimen's value."""
        like = next(iter(draws.values()))

        def of(name: str) -> FloatArray:
            return filled(specimen, name, draws, like)

        length, mass, centre = of("link_length"), of("link_mass"), of("mass_centre")
        gravity = GRAVITY
        if "gravity" in specimen.quantities:
            gravity = specimen.quantities["gravity"].value
        area, thickness = of("window_area"), of("film_thickness")
        permittivity = draws.get("relative_permittivity")
        if permittivity is None:
            permittivity = of("relative_permittivity")
        lever = mass * (length - centre) + of("slider_mass") * length
        return cls(
            model,
            draws,
            length=length,
            inertia=2.0 * of("rotational_inertia") + 2.0 * mass * centre**2,
            turning=4.0 * length * lever,
            weight=2.0 * mass * gravity * centre,
            rest=of("rest_angle"),
            section=area * thickness,
            prestretch=of("prestretch"),
            electric=area * VACUUM_PERMITTIVITY * positive(permittivity) / thickness,
        )

    def film(self, cosine: FloatArray) -> FloatArray:
        """A_0 t_0 sigma [N] at zero voltage, (W, N), at cos theta (N,) or (W, N)."""
        first = column(self.prestretch) * cosine
        stretches = PrincipalStretches(
            first, column(self.prestretch), 1.0 / (column(self.prestretch) * first)
        )
        return column(self.section) * self.model.spring.cauchy_stress(stretches, self.draws)

    @cached_property
    def gent_argument(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a, b, d (W,) of c^2 (1 - (I_1 - 3)/J) = c^2 (a - b c^2) - d, c = cos theta."""
        inverse, square = self.model.spring.inverse_limit(self.draws), self.prestretch**2
        return 1.0 + (3.0 - square) * inverse, square * inverse, inverse / square**2

    @cached_property
    def flattest(self) -> FloatArray:
        """Smallest angle (W,) of the bent branch: 3 degrees, or an angle near the lock-up."""
        a, b, d = self.gent_argument
        rest, last = np.cos(self.rest), np.full_like(self.rest, np.cos(FLATTEST))
        with np.errstate(all="ignore"):  # without a limit, b is zero and `locked` is not finite
            locked = np.sqrt((a + np.sqrt(a * a - 4.0 * b * d)) / (2.0 * b))
        near = rest + LOCK_UP * (locked - rest)
        return np.arccos(np.where(near < last, near, last))

    @cached_property
    def hinge(self) -> FloatArray:
        """4 K [N m], (W,); NaN where the film would need hinges that push."""
        cosine = np.cos(self.rest)
        moment = self.film(column(cosine))[:, 0] * np.tan(self.rest) - self.weight * cosine
        return positive(moment / self.rest)

    def moment(self, angle: FloatArray, voltage: float = 0.0) -> FloatArray:
        """Generalised force on theta [N m] at rest, (W, N), at angles (N,) or (W, N)."""
        sine, cosine = np.sin(angle), np.cos(angle)
        film = self.film(cosine) * sine / cosine
        loads = column(self.weight) * cosine + column(self.hinge) * angle
        return np.asarray(film - loads - column(self.electric) * sine * cosine * voltage**2)

    def force(self, displacement: FloatArray, voltage: float) -> FloatArray:
        """Outward force [N] on the support of the slider, (W, N), at displacements (N,).

        NaN beyond 2 L (1 - cos theta_0), where the links are straight, and for a draw whose rest
        angle is not stable.
        """
        length = column(self.length)
        with np.errstate(invalid="ignore"):  # NaN if the links do not reach that far
            angle = np.arccos(np.cos(column(self.rest)) + displacement / (2.0 * length))
        stays = np.where(self.stiffness_at_rest > 0.0, 1.0, np.nan)
        return -self.moment(angle, voltage) / (2.0 * length * np.sin(angle)) * column(stays)

    def squared_voltage(self, angle: FloatArray) -> FloatArray:
        """U^2 [V^2] for which these angles are in equilibrium, (W, N)."""
        balance = column(self.electric) * np.sin(angle) * np.cos(angle)
        return np.asarray(self.moment(angle) / balance)

    @cached_property
    def branch(self) -> tuple[FloatArray, FloatArray]:
        """Angles and squared voltages of the bent branch, (W, BRANCH_POINTS), starting at rest.

        The branch ends where the structure snaps flat. It also ends near the lock-up of a film,
        where the voltage grows without bound. Past the end the last values are repeated.
        """
        share = np.linspace(0.0, 1.0, BRANCH_POINTS)
        angle = column(self.rest) + column(self.flattest - self.rest) * share
        square = self.squared_voltage(angle)
        square[:, 0] = 0.0
        falling = np.diff(square, axis=1) <= 0.0
        last = np.where(falling.any(axis=1), falling.argmax(axis=1), BRANCH_POINTS - 1)
        kept = np.minimum(np.arange(BRANCH_POINTS), column(last).astype(int))
        return np.take_along_axis(angle, kept, 1), np.take_along_axis(square, kept, 1)

    def equilibrium(self, voltage: float) -> FloatArray:
        """Angle (W,) on the bent branch under a voltage; NaN if the structure snaps flat."""
        angle, square = self.branch
        rows = np.arange(len(angle))
        above = square >= voltage**2
        right = np.clip(above.argmax(axis=1), 1, None)
        low, high = angle[rows, right], angle[rows, right - 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            short = self.squared_voltage(column(middle))[:, 0] < voltage**2
            low, high = np.where(short, low, middle), np.where(short, middle, high)
        found = np.where(voltage == 0.0, self.rest, 0.5 * (low + high))
        return np.where(above.any(axis=1) & (self.stiffness_at_rest > 0.0), found, np.nan)

    @cached_property
    def stiffness_at_rest(self) -> FloatArray:
        """`stiffness` at rest without voltage [N m], (W,); NaN if the rest angle is not stable."""
        return positive(self.stiffness(self.rest))

    def mass(self, angle: FloatArray) -> FloatArray:
        """M = M_0 + C sin^2 theta [kg m^2], (W,)."""
        return np.asarray(self.inertia + self.turning * np.sin(angle) ** 2)

    def stiffness(self, angle: FloatArray, voltage: float = 0.0) -> FloatArray:
        """Return -d moment/d theta [N m], (W,), at angles (W,) under a voltage."""
        h = 1e-4
        both = self.moment(np.stack([angle - h, angle + h], axis=1), voltage)
        return np.asarray((both[:, 0] - both[:, 1]) / (2.0 * h))
