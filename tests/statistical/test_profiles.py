"""Walks along ridges: they reach what is far from the peak, in z and in straight coordinates."""

from dataclasses import dataclass

import numpy as np
import pytest
from tests.shared.densities import LeastSquares

from deabayes.sampling.peaks import Points, fisher_factors
from deabayes.sampling.problem import Coordinates
from deabayes.sampling.warm_up import REACH, profiles, thinned


@dataclass(frozen=True)
class Bend:
    """u_1 = z_1 - 0.7 z_0^2."""

    def straighten(self, u):
        u[:, 1] -= 0.7 * u[:, 0] ** 2
        return 0.0

    def bend(self, u):
        u[:, 1] += 0.7 * u[:, 0] ** 2


def scores(z):
    """0.05 wide across z_1 = 0.7 z_0^2, along which only the prior ends it, and z_2 alone."""
    across = (z[:, 1] - 0.7 * z[:, 0] ** 2) / 0.05
    return np.stack([across, z[:, 2] / 0.1], axis=1)


banana = LeastSquares(scores)


def peak_of(target, z):
    place = np.array([z])
    return Points(
        place, fisher_factors(target, place, np.eye(3)[None], differences=1e-4), target(place)
    )


@pytest.mark.parametrize("coordinates", [None, Coordinates((Bend(),))])
def test_walks_follow_a_bent_ridge_to_its_ends(coordinates):
    """The prior falls by 7 nats along it to z_0 = 2.1 and -2.1."""
    found = profiles(banana, peak_of(banana, [0.0, 0.0, 0.0]), coordinates)
    assert found.z[:, 0].min() < -1.7 and found.z[:, 0].max() > 1.7
    np.testing.assert_allclose(found.value, banana(found.z), atol=1e-9)
    assert (found.value > found.value.max() - REACH).all()
    across = found.z[:, 1] - 0.7 * found.z[:, 0] ** 2
    assert np.abs(across).max() < 0.25
    along = np.stack([np.ones(len(across)), 1.4 * found.z[:, 0], np.zeros(len(across))], axis=1)
    slopes = np.stack([-1.4 * found.z[:, 0], np.ones(len(across))], axis=1) / 0.05
    information = np.tile(np.diag([1.0, 1.0, 101.0]), (len(across), 1, 1))
    information[:, :2, :2] += slopes[:, :, None] * slopes[:, None]
    whitened = np.linalg.inv(found.factors)
    fishers = whitened.transpose(0, 2, 1) @ whitened
    for direction in (along, np.tile(np.eye(3)[1], (len(across), 1))):
        given, exact = (
            np.einsum("ki,kij,kj->k", direction, matrix, direction)
            for matrix in (fishers, information)
        )
        np.testing.assert_allclose(given, exact, rtol=0.2)


def test_a_walk_along_a_normal_profile_ends_early():
    """The peak's own approximation says the rest: a step or two each way are kept."""

    normal = LeastSquares(lambda z: z / [0.3, 0.1, 0.5])
    found = profiles(normal, peak_of(normal, [0.0, 0.0, 0.0]))
    assert len(found.z) <= 1 + 2 * 6


def test_thinning_keeps_the_highest_points_apart():
    z = np.linspace(-1.0, 1.0, 41)[:, None]
    points = Points(z, np.full((41, 1, 1), 0.1), -np.abs(z[:, 0]))
    kept = thinned(points, 5, 1.45)
    np.testing.assert_allclose(np.sort(kept.z[:, 0]), [-0.3, -0.15, 0.0, 0.15, 0.3])
    assert len(thinned(points, 100, 1.45).z) == 13
