"""Three terms and more by the moments of their exponents: exact, one-to-one, and used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_film_stress import HEIGHT, MIDDLE, POSITIVE, SD
from tests.unit.test_film_terms import STRETCHES, film

from deabayes.posterior import LogPosterior
from deabayes.prior.learned import Shown
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.film_moments import FilmMoments, exponent_of, slope_of
from deabayes.sampling.shares import Shares
from deabayes.springs.ogden import stress_of_one


def of_terms(n: int) -> FilmMoments:
    return FilmMoments(tuple(range(n, 2 * n)), tuple(range(n)), MIDDLE, SD, HEIGHT)


def terms(n: int, count: int, seed: int) -> np.ndarray:
    """u of terms: ln v_i, and scores of exponents between 0 and 5, at least 0.01 apart."""
    rng = np.random.default_rng(seed)
    exponents = np.sort(rng.uniform(0.0, 5.0, (2 * count, n)), axis=1)
    exponents = exponents[np.diff(exponents, axis=1).min(axis=1) > 0.01][:count]
    return np.hstack([2.0 * rng.standard_normal((count, n)), (exponents - MIDDLE) / SD])


def straightened(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = u.copy()
    return found, of_terms(u.shape[1] // 2).straighten(found)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_there_and_back(n: int) -> None:
    u = terms(n, 2000, n)
    again = straightened(u)[0]
    of_terms(n).bend(again)
    np.testing.assert_allclose(again, u, atol=1e-8)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_the_jacobian(n: int) -> None:
    u, step = terms(n, 200, 10 + n), 1e-6
    u = u[u[:, n] > (0.05 - MIDDLE) / SD]
    columns = [
        (straightened(u + step * e)[0] - straightened(u - step * e)[0]) / (2 * step)
        for e in np.eye(2 * n)
    ]
    expected = np.linalg.slogdet(np.stack(columns, axis=2))[1]
    np.testing.assert_allclose(straightened(u)[1], expected, atol=1e-4)


def test_the_first_are_the_films_stress_its_slope_and_variance() -> None:
    """Of ln stress by ln lambda_1 and -ln lambda_3, and of y over the shares."""
    u = terms(4, 100, 3)
    alpha = MIDDLE + SD * u[:, 4:]
    mu = np.exp(u[:, :4]) / stress_of_one(alpha, *np.log(STRETCHES))

    def log_stress(nearer: float) -> np.ndarray:
        there = np.log(STRETCHES[0]) + nearer, np.log(STRETCHES[1]) - nearer
        return np.log(np.sum(mu * stress_of_one(alpha, *there), axis=1))

    found = straightened(u)[0]
    np.testing.assert_allclose(found[:, 0], log_stress(0.0), rtol=1e-12)
    slope = (log_stress(1e-5) - log_stress(-1e-5)) / 2e-5
    np.testing.assert_allclose(found[:, 4], slope, rtol=1e-7)
    shares = np.exp(u[:, :4]) / np.exp(u[:, :4]).sum(axis=1, keepdims=True)
    y = alpha / np.tanh(HEIGHT * alpha)
    variance = np.sum(shares * (y - slope[:, None]) ** 2, axis=1)
    np.testing.assert_allclose(found[:, 1] ** 3, variance, rtol=1e-6)


def test_exponents_that_meet_and_terms_that_vanish() -> None:
    """Two as one: what is seen stays as it was, and the way back finds them."""
    u = terms(3, 50, 6)
    u[:, 4] = u[:, 3] + 1e-6
    u[:, 2] -= 15.0
    found, log_jacobian = straightened(u)
    assert np.isfinite(found).all() and np.isfinite(log_jacobian).all()
    again = found.copy()
    of_terms(3).bend(again)
    np.testing.assert_allclose(again[:, 3:5], u[:, 3:5], atol=1e-9)
    np.testing.assert_allclose(
        np.logaddexp(again[:, 0], again[:, 1]), np.logaddexp(u[:, 0], u[:, 1]), atol=1e-9
    )


def test_what_no_terms_make() -> None:
    """A slope below that of an exponent of 0, a b below 0, and what is no number."""
    found = straightened(terms(3, 50, 5))[0]
    flat, beyond, none = found.copy(), found.copy(), found.copy()
    flat[:, 3:] -= 10.0
    beyond[:, 2] *= -1.0
    none[:, 1] = np.nan
    for wrong in (flat, beyond, none):
        with np.errstate(invalid="ignore"):  # as `Coordinates.bend` has it
            of_terms(3).bend(wrong)
        assert np.isnan(wrong).any(axis=1).all()
    negative = terms(3, 50, 5)
    negative[:, 3] = -0.1 - MIDDLE / SD
    assert not np.isfinite(straightened(negative)[1]).any()


@pytest.mark.parametrize("height", [0.5, 2.07])
def test_exponents_of_slopes(height: float) -> None:
    alpha = np.concatenate([np.logspace(-4, 1, 200), [1e-3, 5.0]])
    slopes, change = slope_of(alpha, height)
    np.testing.assert_allclose(slopes, alpha / np.tanh(height * alpha), rtol=1e-12)
    np.testing.assert_allclose(exponent_of(slopes, height), alpha, rtol=1e-6)
    step = 1e-6 * alpha
    numeric = (slope_of(alpha + step, height)[0] - slope_of(alpha - step, height)[0]) / (2 * step)
    np.testing.assert_allclose(change[alpha > 0.01], numeric[alpha > 0.01], rtol=1e-5)


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
    (found,) = (p for p in Coordinates.of(posterior).pairs if isinstance(p, FilmMoments | Shares))
    return type(found)


def test_they_are_used_for_terms_handed_on() -> None:
    posterior = handed_on()
    assert of(posterior) is FilmMoments
    assert of(film("ogden_3", **POSITIVE)) is Shares
    there = Coordinates.of(posterior)
    z = posterior.prior.to_normal(posterior.prior.sample(np.random.default_rng(6), 500))
    u, log_jacobian = there.straighten(z)
    assert np.isfinite(log_jacobian).all()
    np.testing.assert_allclose(there.bend(u), z, atol=1e-4)
