"""The simulated minimum-energy structure as it is: linkage, film, units, friction, instruments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from data.make.sensor import Sensor

from deabayes.experiment import FloatArray

VACUUM_PERMITTIVITY = 8.8541878188e-12
GRAVITY = 9.80665
MONITOR_NOISE = 0.3
"""sd of the amplifier's voltage monitor [V]."""
TILT = 1.2e-4
"""What the tilted laser head reads too much at the end of the stroke [m]: 0.12 % of 100 mm."""
STROKE = 12.35e-3
"""Free displacement at 5 kV [m]."""
Values = TypeVar("Values", float, FloatArray)


@dataclass(frozen=True)
class Truth:
    """The simulated structure and its amplifier, SI.

    Tables 1, 3 (exponents ascending) and 4 of the paper (2019), with stand-ins for window area
    and rest angle, and what it leaves out: the last of the Maxwell units, dry friction beside
    the viscous one, an amplifier that follows its command with a lag.
    """

    link_length: float = 33.5e-3
    mass_centre: float = 15.78e-3
    link_mass: float = 0.603e-3
    slider_mass: float = 0.40e-3
    rotational_inertia: float = 156.56e-9
    film_thickness: float = 40e-6
    prestretch: float = 5.0
    window_area: float = 1.5e-3
    rest_angle: float = math.radians(45.0)
    mu: tuple[float, ...] = (73.98e3, 634.06e3, 127.92e3, 3.45e3)
    alpha: tuple[float, ...] = (0.243, 0.331, 0.744, 3.306)
    relative_permittivity: float = 1.704
    k: tuple[float, ...] = (66.0, 8.0, 3.5, 0.8, 1.0)
    xi: tuple[float, ...] = (0.55, 4.0, 20.0, 50.0, 300.0)
    eta_0: float = 0.1
    dry_friction: float = 3e-4
    dry_friction_speed: float = 1e-5
    amplifier_lag: float = 1e-3

    @cached_property
    def hinge_stiffness(self) -> float:
        """K [N m/rad] for which the rest angle is an equilibrium at 0 V."""
        cosine = math.cos(self.rest_angle)
        pulled = self.film_moment(cosine, math.sin(self.rest_angle), 0.0)
        return (pulled - self.weight_moment(cosine)) / (4.0 * self.rest_angle)

    def stress(self, cosine: Values, voltage: float) -> Values:
        """sigma_x [Pa] of the film at cos(theta) under a voltage [V]."""
        along = self.prestretch * cosine
        across = 1.0 / (along * self.prestretch)
        field = cosine * (voltage / self.film_thickness)
        found = -VACUUM_PERMITTIVITY * self.relative_permittivity * field**2
        for mu, alpha in zip(self.mu, self.alpha, strict=True):
            found = found + mu * (along**alpha - across**alpha)
        return found

    def film_moment(self, cosine: Values, sine: Values, voltage: float) -> Values:
        """The film's generalised force [N m] along theta."""
        volume = self.window_area * self.film_thickness
        return volume * self.stress(cosine, voltage) * sine / cosine

    def weight_moment(self, cosine: Values) -> Values:
        """Derivative of the weight's potential [N m] by theta."""
        return 2.0 * self.link_mass * GRAVITY * self.mass_centre * cosine

    def static_force(self, angle: Values, cosine: Values, sine: Values, voltage: float) -> Values:
        """Force [N] outwards along the slider at rest, all Maxwell units relaxed."""
        held = self.weight_moment(cosine) + 4.0 * self.hinge_stiffness * angle
        return (held - self.film_moment(cosine, sine, voltage)) / (2.0 * self.link_length * sine)

    @property
    def tau(self) -> tuple[float, ...]:
        """Relaxation times of the Maxwell units [s]."""
        return tuple(xi / k for k, xi in zip(self.k, self.xi, strict=True))


TRUTH = Truth()
LASER = Sensor(
    delay=5e-4,
    sigma_white=3e-6,
    sigma_ou=4e-6,
    tau_ou=0.05,
    offset=5e-5,
    drift=2e-7,
    resolution=3e-6,
)
"""The laser displacement sensor [m], its tilt aside."""
LOAD_CELL = Sensor(
    delay=0.0,
    sigma_white=2e-4,
    sigma_ou=1.5e-4,
    tau_ou=60.0,
    offset=1e-4,
    drift=3e-7,
    resolution=1e-5,
)
"""Force [N]."""


def tilted(displacement: FloatArray) -> FloatArray:
    """What the tilted laser head sees of a displacement [m]: its error grows with the square."""
    return displacement + TILT * (displacement / STROKE) ** 2
