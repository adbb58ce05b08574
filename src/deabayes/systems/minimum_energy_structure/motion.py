"""The minimum-energy structure in motion: each draw's constants as the kernel takes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.drive import Drive
from deabayes.systems.minimum_energy_structure.static import FLATTEST, STEEPER, STEEPEST, Structure
from deabayes.systems.specimen_quantities import positive
from deabayes.systems.springs.base import column

ESTIMATE = 10.0
"""Error allowed in a step over the tolerance; a test holds the result to the tolerance."""
RINGING = 3.0
"""Times the damping ratio, at most 1: the share of that which is allowed where it rings, because
the errors of as many periods add up as are remembered."""
HELD = 20.0
"""Times the share of the drive that dry friction bears, plus 1: what is allowed is divided by it,
because errors stay where the slider does, and the range is smaller."""
ROUNDING = 1e-13
"""Error [rad] below which none is asked of a step, as at hardly any voltage."""
FIRST_STEP = 0.1
"""Of the time in which the structure, its units stiff, turns by a radian of its oscillation."""

MISSED = 1e-6
"""Of the film's stress at rest: what its polynomial may miss. The reference specimen's misses
2.5e-9 at most with exponents from -5 to 10."""
CUT, CUTS = 0.75, 9
"""How far beyond rest a draw is followed of what was tried before, and how often that is tried."""


@dataclass(frozen=True)
class Motion:
    """Angle (W, N); steps tried and the time at which a draw was lost, else NaN, (W,)."""

    angle: FloatArray
    steps: NDArray[np.int64]
    ended: FloatArray


def follow(
    structure: Structure,
    history: Drive,
    times: FloatArray,
    tolerance: float,
    start: FloatArray,
    most_steps: int | None = None,
) -> Motion:
    """Integrate draws through a voltage history, from rest at the angles `start` (W,).

    Parameters
    ----------
    times : (N,) ascending [s].
    tolerance : error of the displacement relative to its range.
    most_steps : of a draw, which is lost where it needs more.
    """
    from deabayes.systems.minimum_energy_structure.step import MOST_STEPS, integrate

    walkers = structure.rest.size
    found = Motion(
        np.empty((walkers, times.size)), np.empty(walkers, dtype=np.int64), np.empty(walkers)
    )
    constants, units = constants_of(structure, history, tolerance, start)
    integrate(
        history.edges, history.coefficients, history.restart, times, constants, units,
        most_steps or MOST_STEPS, found.angle, found.steps, found.ended,
    )  # fmt: skip
    return found


def constants_of(
    structure: Structure, history: Drive, tolerance: float, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Draws (W, DRAW_COLUMNS) and units (W, n, 4) as `structure_lanes.integrate` takes them."""
    model, draws, rest = structure.model, structure.draws, structure.rest
    stiffness, times = model.unit_draws(draws)
    total = positive(stiffness).sum(axis=1)
    lever = 2.0 * structure.length * np.sin(rest)
    stiff = structure.stiffness_at_rest + lever**2 * total
    slow = np.sqrt(structure.mass(rest) / stiff)
    friction = positive(draws["friction_force" if model.dry else "eta_0"])
    allowed = _allowed(structure, history, tolerance, friction, lever, stiff)
    low = np.full_like(rest, FLATTEST)
    high, (middle, scale, film, _) = followed(structure, low)
    none = np.zeros_like(rest)
    columns = (
        start, FIRST_STEP * slow, low, high,
        structure.inertia, structure.turning, structure.electric, structure.hinge,
        structure.weight, 2.0 * structure.length, np.cos(rest),
        none if model.dry else friction, friction if model.dry else none,
        total, slow, middle, scale, 1.0 / allowed, *structure.gent_argument,
    )  # fmt: skip
    moved = 2.0 * structure.length * (np.cos(start) - np.cos(rest))
    weight = stiffness * column(lever / stiff)
    parts = (1.0 / positive(times), stiffness, weight, column(-moved))
    units = np.stack(np.broadcast_arrays(*parts), axis=2)
    return np.concatenate([np.stack(columns, axis=1), film], axis=1), np.ascontiguousarray(units)


def _allowed(
    structure: Structure,
    history: Drive,
    tolerance: float,
    friction: FloatArray,
    lever: FloatArray,
    stiff: FloatArray,
) -> FloatArray:
    """Error of the angle allowed in a step (W,), by what the draws tell before integration.

    Parameters
    ----------
    friction : F_c or eta_0; `lever` from the slider to the angle, `stiff` its stiffness with
        stiff units, each (W,).
    """
    dry, rest = structure.model.dry, structure.rest
    slow = np.sqrt(structure.mass(rest) / stiff)
    push = structure.electric * np.sin(rest) * np.cos(rest) * history.peak**2
    push = np.where(push > 0.0, push, 1e-12 * stiff)
    swing = push / stiff
    # Dry friction resists like viscous friction at the speed of the swing.
    viscous = friction * slow / (lever * swing) if dry else friction
    damping = 0.5 * viscous * lever**2 / (stiff * slow)
    forgotten = np.maximum(damping, slow / np.ptp(history.edges))
    allowed = ESTIMATE * tolerance * swing * np.minimum(1.0, RINGING * forgotten)
    if dry:
        allowed = allowed / (1.0 + HELD * friction * lever / push)
    return np.maximum(allowed, ROUNDING)


class FilmPolynomial(NamedTuple):
    """P in powers of z = scale (cos theta - middle): the highest (W, FILM_DEGREE + 1) last.

    `missed` (W,) [N] is what its two highest Chebyshev terms have, more than what it misses.
    """

    middle: FloatArray
    scale: FloatArray
    powers: FloatArray
    missed: FloatArray


def followed(structure: Structure, low: FloatArray) -> tuple[FloatArray, FilmPolynomial]:
    """The steepest angle (W,) to which draws are followed, and the polynomial up to there.

    A film that stiffens too steeply for a polynomial, as one of little pre-stretch does in
    lambda_z^alpha, is followed less far beyond rest; NaN where it is missed right there.
    """
    rest = structure.rest
    high = np.minimum(rest + STEEPER, STEEPEST)
    allowed = MISSED * np.abs(_endless(structure).film(column(np.cos(rest)))[:, 0])
    for _ in range(CUTS):
        film = film_polynomial(structure, low, high)
        poor = film.missed > allowed
        if not poor.any():
            return high, film
        high = np.where(poor, rest + CUT * (high - rest), high)
    return np.where(poor, np.nan, high), film


def film_polynomial(structure: Structure, low: FloatArray, high: FloatArray) -> FilmPolynomial:
    """P = A_0 t_0 sigma B at zero voltage as a polynomial in cos theta.

    B is the argument of a Gent spring, whose pole is left to the kernel; 1 for other springs.

    Interpolated at Chebyshev's nodes between the angles `low` and `high`, each draw's own, (W,).
    """
    top, bottom = np.cos(low), np.cos(high)
    middle, scale = 0.5 * (top + bottom), 2.0 / (top - bottom)
    nodes, to_powers, last = _chebyshev()
    # einsum, as a product by BLAS would make a draw's last digits depend on its neighbours.
    values = _endless(structure).film(column(middle) + nodes / column(scale))
    missed = np.abs(np.einsum("wn,pn->wp", values, last)).sum(axis=1)
    return FilmPolynomial(middle, scale, np.einsum("wn,pn->wp", values, to_powers), missed)


@cache
def _chebyshev() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes, and what makes of values there the powers and the two highest Chebyshev terms."""
    from deabayes.systems.minimum_energy_structure.kernel import FILM_DEGREE

    count = FILM_DEGREE + 1
    angles = np.pi * (np.arange(count) + 0.5) / count
    nodes = np.cos(angles)
    to_powers = np.linalg.inv(np.vander(nodes, increasing=True))
    last = 2.0 / count * np.cos(np.outer([FILM_DEGREE - 1, FILM_DEGREE], angles))
    return nodes, to_powers, last


def _endless(structure: Structure) -> Structure:
    """With a film whose stretch has no limit."""
    return replace(structure, draws=structure.model.spring.without_limit(structure.draws))
