"""Two terms by the film's stress at three stretches: exact, one-to-one, and used where it pays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.prior.test_learned import FILM, handed_on
from tests.shared.coordinates import coordinates_of, parts_of
from tests.systems.test_film_terms import STRETCHES, film, inherited

from deabayes.inference.log_posterior import LogPosterior
from deabayes.systems.ridges.film import FilmStress, to_terms
from deabayes.systems.ridges.terms import HEIGHTS
from deabayes.systems.ridges.units import Shares
from deabayes.systems.springs.ogden import stress_of_one

HEIGHT = np.log(STRETCHES[0] / STRETCHES[1]) / 2.0
MIDDLE, SD = 2.5, 5.0 / np.sqrt(12.0)
THERE = FilmStress((2, 3), (0, 1), MIDDLE, SD, HEIGHT * np.array(HEIGHTS))


def terms(count: int, seed: int) -> np.ndarray:
    """u of two terms: ln v_i, and scores of exponents between 0 and 5, ascending."""
    rng = np.random.default_rng(seed)
    exponents = np.sort(rng.uniform(0.0, 5.0, (count, 2)), axis=1)
    return np.hstack([3.0 * rng.standard_normal((count, 2)), (exponents - MIDDLE) / SD])


def straightened(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = u.copy()
    return found, THERE.straighten(found)


def test_there_and_back() -> None:
    u = terms(2_000, 1)
    found, _ = straightened(u)
    again = found.copy()
    THERE.bend(again)
    told_apart = (u[:, 3] - u[:, 2] > 0.2) & (np.abs(u[:, 1] - u[:, 0]) < 5.0)
    assert told_apart.sum() > 1_000
    np.testing.assert_allclose(again[told_apart], u[told_apart], atol=1e-7)
    np.testing.assert_allclose(straightened(again)[0], found, atol=1e-12)


def test_the_jacobian() -> None:
    u, step = terms(500, 2), 1e-6
    u = u[(u[:, 3] - u[:, 2] > 0.1) & (u[:, 2] > (0.1 - MIDDLE) / SD)]
    columns = [
        (straightened(u + step * e)[0] - straightened(u - step * e)[0]) / (2 * step)
        for e in np.eye(4)
    ]
    expected = np.linalg.slogdet(np.stack(columns, axis=2))[1]
    np.testing.assert_allclose(straightened(u)[1], expected, atol=0.01)


def test_they_are_the_films_stresses() -> None:
    """At a lambda_1 that is further or less far, the second stretch being what it is."""
    u = terms(100, 3)
    alpha = MIDDLE + SD * u[:, 2:]
    mu = np.exp(u[:, :2]) / stress_of_one(alpha, *np.log(STRETCHES))
    found, _ = straightened(u)
    stresses = np.exp(np.cumsum(found[:, [0, 1, 2]], axis=1))
    for part, stress in zip(HEIGHTS, stresses.T, strict=True):
        nearer = (1.0 - part) * HEIGHT
        there = np.log(STRETCHES[0]) - nearer, np.log(STRETCHES[1]) + nearer
        expected = np.sum(mu * stress_of_one(alpha, *there), axis=1)
        np.testing.assert_allclose(stress, expected, rtol=1e-10)


def test_near_an_exponent_of_zero() -> None:
    """Where sinh is its argument: the same to the digits that the sum has."""
    u = np.tile(terms(1, 4), (2, 1))
    u[:, 2] = (np.array([0.99e-4, 1.01e-4]) / HEIGHT - MIDDLE) / SD
    found, log_jacobian = straightened(u)
    np.testing.assert_allclose(found[0], found[1], atol=1e-8)
    assert log_jacobian[1] - log_jacobian[0] == pytest.approx(np.log(1.01 / 0.99), abs=1e-4)


def test_stresses_that_no_terms_make() -> None:
    """Straighter than any two powers with that second exponent, or falling."""
    found, _ = straightened(terms(50, 5))
    for column, change in ((2, 0.5), (1, -3.0), (1, 1.0)):
        other = found.copy()
        other[:, column] += change
        THERE.bend(other)
        assert np.isnan(other[:, [0, 1, 2]]).all(axis=1).mean() > 0.9


def test_there_is_one_exponent_only() -> None:
    """The chord of rho_3 over rho_2 falls as alpha_1 rises, whatever alpha_2 is."""
    psi = [np.sinh(h * np.linspace(1e-3, 5.0, 2000)) for h in THERE.heights]
    second, third = psi[1] / psi[0], psi[2] / psi[0]
    for last in (5, 50, 500, 1999):
        chord = (third[:last] - third[last]) / (second[:last] - second[last])
        assert (np.diff(chord) < 0.0).all()


POSITIVE = {"alpha": {"distribution": "uniform", "lower": 0, "upper": 5}}


def handed_on_with(small_share: float = 1.0, **priors: object) -> LogPosterior:
    """A film under that of `test_learned` with both terms seen, and with less of the second."""
    _, prior, theta, _ = handed_on()
    draws = theta[:, [prior.names.index(name) for name in FILM]]
    stresses = draws[:, :2] * stress_of_one(draws[:, 2:4], *np.log(STRETCHES))
    seen = stresses.min(axis=1) > 0.02 * stresses.sum(axis=1)
    draws = draws[seen & (draws[:, 2] > 0.0) & (draws[:, 3] < 5.0)]
    draws[:, 1] *= small_share
    posterior = film("ogden_2", **priors)
    return replace(posterior, prior=posterior.prior.inherit(FILM, draws))


def of(posterior: LogPosterior) -> type:
    """What takes the terms of its film on."""
    (found,) = parts_of(posterior, FilmStress, Shares)
    return type(found)


@pytest.fixture(scope="module")
def two_seen() -> LogPosterior:
    return handed_on_with(**POSITIVE)


def test_they_are_used_for_two_terms_handed_on(two_seen: LogPosterior) -> None:
    assert of(two_seen) is FilmStress
    assert of(film("ogden_2", **POSITIVE)) is Shares
    assert of(inherited("ogden_3")) is Shares


def test_they_are_not_where_they_are_not_one_to_one() -> None:
    """An exponent and its negative make the same film; a term that vanishes has no exponent."""
    assert of(handed_on_with()) is Shares
    assert of(handed_on_with(0.02, **POSITIVE)) is Shares


def test_there_and_back_from_scores(two_seen: LogPosterior) -> None:
    there = coordinates_of(two_seen)
    theta = two_seen.prior.sample(np.random.default_rng(6), 500)
    z = two_seen.prior.to_normal(theta)
    u, log_jacobian = there.straighten(z)
    assert np.isfinite(log_jacobian).all()
    np.testing.assert_allclose(there.bend(u), z, atol=1e-5)
    assert np.isnan(to_terms(np.array([1.0]), np.full((1, 3), np.nan), THERE.heights)[0]).all()
