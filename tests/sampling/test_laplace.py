"""Laplace's method: exact for a normal posterior, and honest about any other."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.sampling.laplace import _Normal, laplace
from deabayes.sampling.problem import Coordinates, EveryDrawFailed, Problem, Target

SIZE = 4000


def found(log_likelihood, dimension=2, **hints):
    return laplace(Problem(log_likelihood, dimension, **hints), np.random.default_rng(1), SIZE)


def test_a_normal_posterior_is_found_exactly() -> None:
    """z has the prior N(0, I) and is measured with a covariance: mean and covariance are known."""
    precision = np.array([[40.0, 12.0], [12.0, 9.0]])
    measured = np.array([0.7, -0.4])
    covariance = np.linalg.inv(precision + np.eye(2))
    mean = covariance @ precision @ measured

    def log_likelihood(z):
        return -0.5 * np.einsum("wi,ij,wj->w", z - measured, precision, z - measured)

    normal = found(log_likelihood)
    np.testing.assert_allclose(normal.peak, mean, atol=1e-2)
    np.testing.assert_allclose(np.cov(normal.draws.T), covariance, atol=4 * 0.1 / SIZE**0.5)
    assert normal.agreed == normal.climbs and normal.next_lower is None
    assert normal.not_curved == 0 and normal.effective > 0.98


def test_another_peak_is_told() -> None:
    def log_likelihood(z):
        x = 20.0 * (z[:, 0] ** 2 - 1.0) ** 2
        return -x - 2.0 * (z[:, 0] < 0.0) - 50.0 * z[:, 1] ** 2

    two = found(log_likelihood)
    assert two.peak[0] > 0.0
    assert 0 < two.agreed < two.climbs
    assert two.next_lower == pytest.approx(2.0, abs=0.1)


def test_a_peak_without_curvature_is_told() -> None:
    """The density rises from the highest point, along a line, in steps: a box without a top."""

    def log_likelihood(z):
        return np.where(np.abs(z[:, 0]) < 0.05, 0.0, 5.0 * z[:, 0] ** 2) - 30.0 * z[:, 1] ** 2

    assert found(log_likelihood).not_curved > 0


def test_a_model_that_fails_beside_the_peak_is_told() -> None:
    def log_likelihood(z):
        inside = np.abs(z[:, 0] - 1.0) < 1e-3
        return np.where(inside, 0.0, np.where(z[:, 0] < 1.0, -((z[:, 0] - 1.0) ** 2), -np.inf))

    edge = found(log_likelihood)
    assert edge.not_curved == 1, "the other direction is the prior's"
    assert np.isfinite(edge.draws).all()


def test_a_normal_density_whose_draws_all_fail_has_none() -> None:
    """As beside a peak that is much narrower than its curvature says."""

    def fails_beside_zero(z):
        return np.where(np.abs(z).max(axis=1) < 1e-12, 0.0, np.nan)

    target = Target(fails_beside_zero)
    normal = _Normal(target, Coordinates(), np.zeros(2), np.eye(2), 0)
    draws, effective = normal.sample(np.random.default_rng(1), SIZE)
    assert draws.shape == (0, 2) and effective == 0.0


def test_a_bent_ridge_is_called_not_normal_unless_coordinates_straighten_it() -> None:
    class Bend:
        def straighten(self, u):
            u[:, 1] -= u[:, 0] ** 2
            return 0.0

        def bend(self, u):
            u[:, 1] += u[:, 0] ** 2

    def log_likelihood(z):
        return -0.5 * ((z[:, 1] - z[:, 0] ** 2) / 0.01) ** 2

    bent = found(log_likelihood)
    straight = found(log_likelihood, coordinates=Coordinates((Bend(),)))
    assert bent.effective < 0.1 < 0.2 < straight.effective


def test_the_density_is_that_of_the_straight_coordinates() -> None:
    """exp(z) is normal: its density has the factor exp(z), which z must have too."""

    class Logarithm:
        def straighten(self, u):
            jacobian = u[:, 0].copy()
            u[:, 0] = np.exp(u[:, 0])
            return jacobian

        def bend(self, u):
            u[:, 0] = np.log(u[:, 0])

    def log_likelihood(z):
        return -0.5 * ((np.exp(z[:, 0]) - 1.0) / 0.4) ** 2 + z[:, 0] + 0.5 * z[:, 0] ** 2

    normal = found(log_likelihood, coordinates=Coordinates((Logarithm(),)))
    assert normal.effective > 0.8
    assert np.exp(normal.draws[:, 0]).std() == pytest.approx(0.4, rel=0.04)


def test_no_start_with_a_likelihood_is_an_error() -> None:
    with pytest.raises(EveryDrawFailed):
        found(lambda z: np.full(len(z), np.nan))
