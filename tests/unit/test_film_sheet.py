"""Three terms and more by the film's stress at as many stretches: exact, one-to-one, and used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_film_stress import HEIGHT, MIDDLE, POSITIVE, SD
from tests.unit.test_film_terms import STRETCHES, film

from deabayes.posterior import LogPosterior
from deabayes.prior.learned import Shown
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.film_terms import FilmTerms
from deabayes.sampling.shares import Shares
from deabayes.sampling.terms import NEXT_HEIGHT
from deabayes.springs.ogden import stress_of_one


def of_terms(n: int) -> FilmTerms:
    heights = HEIGHT * (1.0 - NEXT_HEIGHT * np.arange(n))
    return FilmTerms(tuple(range(n, 2 * n)), tuple(range(n)), MIDDLE, SD, heights)


def terms(n: int, count: int, seed: int) -> np.ndarray:
    """u of terms: ln v_i, and scores of exponents between 0 and 5, at least 0.2 apart."""
    rng = np.random.default_rng(seed)
    exponents = np.sort(rng.uniform(0.0, 5.0, (20 * count, n)), axis=1)
    exponents = exponents[np.diff(exponents, axis=1).min(axis=1) > 0.2][:count]
    return np.hstack([rng.standard_normal((count, n)), (exponents - MIDDLE) / SD])


def straightened(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = u.copy()
    return found, of_terms(u.shape[1] // 2).straighten(found)


@pytest.mark.parametrize("n", [3, 4])
def test_there_and_back(n: int) -> None:
    u = terms(n, 2000, n)
    again = straightened(u)[0]
    of_terms(n).bend(again)
    np.testing.assert_allclose(again, u, atol=1e-6)


@pytest.mark.parametrize("n", [3, 4])
def test_the_jacobian(n: int) -> None:
    u, step = terms(n, 200, 10 + n), 1e-6
    columns = [
        (straightened(u + step * e)[0] - straightened(u - step * e)[0]) / (2 * step)
        for e in np.eye(2 * n)
    ]
    expected = np.linalg.slogdet(np.stack(columns, axis=2))[1]
    np.testing.assert_allclose(straightened(u)[1], expected, atol=0.01)


def test_they_are_the_films_stresses() -> None:
    """At a lambda_1 that is less far, the second stretch being what it is."""
    u = terms(4, 100, 3)
    alpha = MIDDLE + SD * u[:, 4:]
    mu = np.exp(u[:, :4]) / stress_of_one(alpha, *np.log(STRETCHES))
    stresses = np.exp(np.cumsum(straightened(u)[0][:, :4], axis=1))
    for height, stress in zip(of_terms(4).heights, stresses.T, strict=True):
        nearer = HEIGHT - height
        there = np.log(STRETCHES[0]) - nearer, np.log(STRETCHES[1]) + nearer
        expected = np.sum(mu * stress_of_one(alpha, *there), axis=1)
        np.testing.assert_allclose(stress, expected, rtol=1e-10)


def test_stresses_that_no_terms_make() -> None:
    """A stress that falls; exponents that do not rise, or meet, or are negative."""
    found = straightened(terms(3, 50, 5))[0]
    falling, meeting, negative = found.copy(), found.copy(), found.copy()
    falling[:, 1] += 3.0
    meeting[:, 4] = meeting[:, 3]
    negative[:, 3] = -0.1 - MIDDLE / SD
    for wrong in (falling, meeting, negative, found[:, [0, 1, 2, 5, 4, 3]], np.nan * found):
        with np.errstate(invalid="ignore"):
            of_terms(3).bend(wrong)
        assert np.isnan(wrong[:, :3]).any(axis=1).all()


FILM = ("mu_1", "mu_2", "mu_3", "alpha_1", "alpha_2", "alpha_3", "relative_permittivity")


def handed_on() -> LogPosterior:
    """Three terms under exact draws of a film whose stress is known to 30 %."""
    posterior = film("ogden_3", **POSITIVE)
    prior, rng = posterior.prior, np.random.default_rng(1)
    theta = prior.sample(rng, 200_000)
    columns = [prior.names.index(name) for name in FILM]
    shown = Shown.by([prior.parameters[column] for column in columns])
    features = shown(theta[:, columns], prior.to_normal(theta)[:, columns])[:, :5]
    about = shown(np.array([[3e5, 1e4, 1e3, 1.0, 2.5, 4.0, 2.0]]), np.zeros((1, 7)))[:, :5]
    log_likelihood = -0.5 * np.sum(((features / about - 1.0) / 0.3) ** 2, axis=1)
    draws = theta[np.log(rng.random(len(theta))) < log_likelihood][:, columns]
    assert len(draws) > 3000
    return replace(posterior, prior=prior.inherit(FILM, draws))


def of(posterior: LogPosterior) -> type:
    """What takes the terms of its film on."""
    (found,) = (p for p in Coordinates.of(posterior).pairs if isinstance(p, FilmTerms | Shares))
    return type(found)


def test_they_are_used_for_terms_handed_on() -> None:
    posterior = handed_on()
    assert of(posterior) is FilmTerms
    assert of(film("ogden_3", **POSITIVE)) is Shares
    there = Coordinates.of(posterior)
    z = posterior.prior.to_normal(posterior.prior.sample(np.random.default_rng(6), 500))
    u, log_jacobian = there.straighten(z)
    assert np.isfinite(log_jacobian).all()
    np.testing.assert_allclose(there.bend(u), z, atol=1e-4)
