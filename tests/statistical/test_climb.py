"""Climbing onto a bulk that particles have missed."""

import numpy as np
import pytest

from deabayes.sampling.climb import _triangular, bulk_missed, draws_of_peaks, find_peaks
from deabayes.sampling.smc import Population

DIMENSION = 6
MEAN = np.linspace(-1.0, 1.0, DIMENSION)
FACTOR = np.tril(np.random.default_rng(0).standard_normal((DIMENSION, DIMENSION))) * 0.05
FACTOR += np.diag(np.geomspace(0.002, 0.3, DIMENSION))
PRECISION = np.linalg.inv(FACTOR @ FACTOR.T)


def thin_normal(z):
    return 7.0 - 0.5 * np.einsum("wi,ij,wj->w", z - MEAN, PRECISION, z - MEAN)


def population(particles, target):
    rng = np.random.default_rng(3)
    return Population(
        particles, particles, rng.standard_normal(particles.shape), target(particles),
        np.zeros(len(particles)), 0.0, (0.0, 1.0), 1,
    )  # fmt: skip


def far_particles(target):
    rng = np.random.default_rng(1)
    return population(MEAN + 0.3 + 0.2 * rng.standard_normal((300, DIMENSION)), target)


def test_peaks_of_a_thin_normal_are_found_with_its_covariance():
    rng = np.random.default_rng(2)
    far = far_particles(thin_normal)
    peaks = find_peaks(thin_normal, far, rng)
    assert max(peak.log_density for peak in peaks) == pytest.approx(7.0, abs=0.01)
    best = max(peaks, key=lambda peak: peak.log_density)
    assert np.linalg.norm(np.linalg.solve(FACTOR, best.z - MEAN)) < 0.1
    whitened = np.linalg.solve(FACTOR, best.factor)
    assert np.allclose(whitened @ whitened.T, np.eye(DIMENSION), atol=0.05)
    assert bulk_missed(far.log_base, best.log_density, DIMENSION)


def test_draws_of_the_peaks_lie_on_the_bulk():
    rng = np.random.default_rng(4)
    peaks = find_peaks(thin_normal, far_particles(thin_normal), rng)
    z = draws_of_peaks(thin_normal, peaks, 4000, rng)
    assert not bulk_missed(thin_normal(z), 7.0, DIMENSION)
    white = np.linalg.solve(FACTOR, (z - MEAN).T)
    assert np.abs(white.mean(axis=1)).max() < 0.15
    assert white.std(axis=1) == pytest.approx(np.ones(DIMENSION), abs=0.15)


def test_particles_of_the_posterior_itself_have_not_missed_it():
    rng = np.random.default_rng(5)
    z = MEAN + rng.standard_normal((500, DIMENSION)) @ FACTOR.T
    assert not bulk_missed(thin_normal(z), 7.0, DIMENSION)


def test_the_better_of_two_modes_is_kept_where_the_particles_are_at_the_worse():
    def two_modes(z):
        near = -0.5 * (((z - 2.0) / 0.05) ** 2).sum(axis=1) - 30.0
        far = -0.5 * (((z + 2.0) / 0.05) ** 2).sum(axis=1)
        return np.logaddexp(near, far)

    rng = np.random.default_rng(6)
    at_worse = population(2.0 + 0.05 * rng.standard_normal((300, 3)), two_modes)
    peaks = find_peaks(two_modes, at_worse, rng)
    assert all(np.allclose(peak.z, -2.0, atol=0.02) for peak in peaks)


def test_a_failing_half_space_does_not_stop_the_climb():
    def half(z):
        return np.where(z[:, 0] > MEAN[0] + 1.0, -np.inf, thin_normal(z))

    peaks = find_peaks(half, far_particles(half), np.random.default_rng(7))
    assert max(peak.log_density for peak in peaks) == pytest.approx(7.0, abs=0.01)


def test_a_direction_a_billion_times_thinner_than_another_has_a_factor():
    directions = np.linalg.qr(np.random.default_rng(8).standard_normal((3, 3)))[0]
    factor = _triangular(directions * np.array([1.0, 1e-5, 1e-10]))
    assert np.array_equal(factor, np.tril(factor))
    assert (np.diag(factor) > 0.0).all()
    assert np.prod(np.diag(factor)) == pytest.approx(1e-15, rel=1e-4)


def test_a_handful_of_particles_is_climbed_from_too():
    rng = np.random.default_rng(9)
    few = population(MEAN + 0.01 * rng.standard_normal((3, DIMENSION)), thin_normal)
    assert max(peak.log_density for peak in find_peaks(thin_normal, few, rng)) > 6.9
