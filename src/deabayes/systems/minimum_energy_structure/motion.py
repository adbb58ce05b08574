"""The minimum-energy structure in motion: the constants of the draws for the compiled kernel."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.arrow import Motion
from deabayes.integrate.drive import Drive
from deabayes.systems.minimum_energy_structure.static import FLATTEST, STEEPER, STEEPEST, Structure
from deabayes.systems.specimen_quantities import positive
from deabayes.systems.springs.base import column

ESTIMATE = 10.0
"""Allowed error of a step over the tolerance; a test checks that the result has the tolerance."""
RINGING = 3.0
"""For oscillations the allowed error is multiplied by RINGING times the damping ratio, at most 1,
because with little damping the errors of many periods add up."""
HELD = 20.0
"""With dry friction the allowed error is divided by 1 + HELD times the ratio of friction to drive:
errors remain where the slider sticks, and the range of the displacement is smaller."""
ROUNDING = 1e-13
"""Smallest allowed error [rad] of a step, which applies if the voltage is almost zero."""
FIRST_STEP = 0.1
"""First step over 1/(angular frequency) of the structure with stiff units."""

MISSED = 1e-6
"""Allowed error of the film's polynomial over the film's stress at rest. For the reference
specimen with exponents from -5 to 10 the error is at most 2.5e-9."""
CUT, CUTS = 0.75, 9
"""If the polynomial is not accurate enough, its range beyond the rest angle is multiplied by CUT.
The polynomial is computed at most CUTS times."""


def follow(
    structure: Structure,
    history: Drive,
    times: FloatArray,
    tolerance: float,
    start: FloatArray,
    most_steps: int | None = None,
) -> Motion:
    """Integrate the draws under a voltage history, from the angles `start` (W,) with zero speed.

    Parameters
    ----------
    times : (N,) ascending [s].
    tolerance : error of the displacement relative to its range.
    most_steps : largest number of steps of a draw; a draw that needs more has failed.
    """
    from deabayes.systems.minimum_energy_structure.kernel import MOST_STEPS, integrate

    found = Motion.empty(structure.rest.size, times.size)
    constants, units = constants_of(structure, history, tolerance, start)
    integrate(
        history.edges, history.coefficients, history.restart, times, constants, units,
        most_steps or MOST_STEPS, found.values, found.steps, found.ended,
    )  # fmt: skip
    return found


def constants_of(
    structure: Structure, history: Drive, tolerance: float, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return draws (W, columns) and units (W, n, 4) for `kernel.integrate`."""
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
        start, FIRST_STEP * slow, low, high, 1.0 / allowed,
        structure.inertia, structure.turning, structure.electric, structure.hinge,
        structure.weight, 2.0 * structure.length, np.cos(rest),
        none if model.dry else friction, friction if model.dry else none,
        total, slow, middle, scale, *structure.gent_argument,
    )  # fmt: skip
    moved = 2.0 * structure.length * (np.cos(start) - np.cos(rest))
    weight = stiffness * column(lever / stiff)
    parts = (column(-moved), 1.0 / positive(times), stiffness, weight)
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
    """Allowed error of the angle in a step (W,), estimated before the integration.

    Parameters
    ----------
    friction : F_c or eta_0, (W,).
    lever : displacement of the slider per angle at rest, (W,).
    stiff : stiffness of the angle at rest with stiff units, (W,).
    """
    dry, rest = structure.model.dry, structure.rest
    slow = np.sqrt(structure.mass(rest) / stiff)
    push = structure.electric * np.sin(rest) * np.cos(rest) * history.peak**2
    push = np.where(push > 0.0, push, 1e-12 * stiff)
    swing = push / stiff
    # Dry friction is replaced by the viscous friction with the same force at the speed of a swing.
    viscous = friction * slow / (lever * swing) if dry else friction
    damping = 0.5 * viscous * lever**2 / (stiff * slow)
    forgotten = np.maximum(damping, slow / np.ptp(history.edges))
    allowed = ESTIMATE * tolerance * swing * np.minimum(1.0, RINGING * forgotten)
    if dry:
        allowed = allowed / (1.0 + HELD * friction * lever / push)
    return np.maximum(allowed, ROUNDING)


class FilmPolynomial(NamedTuple):
    """P in ascending powers of z = scale (cos theta - middle), (W, FILM_DEGREE + 1).

    `missed` (W,) [N] is the size of the two highest Chebyshev terms. It is larger than the error
    of the polynomial.
    """

    middle: FloatArray
    scale: FloatArray
    powers: FloatArray
    missed: FloatArray


def followed(structure: Structure, low: FloatArray) -> tuple[FloatArray, FilmPolynomial]:
    """Return the steepest angle (W,) that a draw may reach, and the polynomial up to there.

    Some films stiffen too steeply for a polynomial, for example in lambda_z^alpha with little
    pre-stretch. For these the steepest angle is closer to the rest angle. It is NaN if the
    polynomial is not accurate close to the rest angle either.
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
    """Return P = A_0 t_0 sigma B at zero voltage as a polynomial in cos theta.

    B is the argument of a Gent spring; the kernel divides by it. B is 1 for other springs. The
    polynomial interpolates P at Chebyshev nodes between the angles `low` and `high` (W,).
    """
    top, bottom = np.cos(low), np.cos(high)
    middle, scale = 0.5 * (top + bottom), 2.0 / (top - bottom)
    nodes, to_powers, last = _chebyshev()
    # einsum, because with BLAS the last digits of a draw would depend on the other draws.
    values = _endless(structure).film(column(middle) + nodes / column(scale))
    missed = np.abs(np.einsum("wn,pn->wp", values, last)).sum(axis=1)
    return FilmPolynomial(middle, scale, np.einsum("wn,pn->wp", values, to_powers), missed)


@cache
def _chebyshev() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nodes, and matrices from values there to powers and to the last Chebyshev terms."""
    from deabayes.systems.minimum_energy_structure.kernel import FILM_DEGREE

    count = FILM_DEGREE + 1
    angles = np.pi * (np.arange(count) + 0.5) / count
    nodes = np.cos(angles)
    to_powers = np.linalg.inv(np.vander(nodes, increasing=True))
    last = 2.0 / count * np.cos(np.outer([FILM_DEGREE - 1, FILM_DEGREE], angles))
    return nodes, to_powers, last


def _endless(structure: Structure) -> Structure:
    """Return the structure with a film whose stretch has no limit."""
    return replace(structure, draws=structure.model.spring.without_limit(structure.draws))
