"""Walks along ridges: they reach what is far from the peak, in z and in straight coordinates."""

from dataclasses import dataclass

import numpy as np
import pytest
from tests.densities import LeastSquares

from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.laplace import Points, laplace_factors
from deabayes.sampling.profiles import REACH, profiles, thinned


@dataclass(frozen=True)
class Bend:
    """u_1 = z_1 - 2 z_0^2."""

    def straighten(self, u):
        u[:, 1] -= 2.0 * u[:, 0] ** 2
        return 0.0

    def bend(self, u):
        u[:, 1] += 2.0 * u[:, 0] ** 2


def scores(z):
    """Peak at z_0 = 1, long along z_0, 0.02 wide across, and z_2 alone."""
    across = (z[:, 1] - 2.0 * z[:, 0] ** 2) / 0.02
    return np.stack([z[:, 0] - 1.0, across, z[:, 2] / 0.1], axis=1)


banana = LeastSquares(scores)


def peak_of(target, z):
    place = np.array([z])
    return Points(place, laplace_factors(target, place, np.eye(3)[None]), target(place))


@pytest.mark.parametrize("coordinates", [None, Coordinates((Bend(),))])
def test_walks_follow_a_bent_ridge_to_its_ends(coordinates):
    """3.7 standard deviations each way are 7 nats: -2.7 and 4.7, beyond the prior's 4."""
    found = profiles(banana, peak_of(banana, [1.0, 2.0, 0.0]), coordinates)
    assert found.z[:, 0].min() < -1.5 and found.z[:, 0].max() > 3.0
    np.testing.assert_allclose(found.value, banana(found.z), atol=1e-9)
    assert (found.value > -REACH).all()
    across = found.z[:, 1] - 2.0 * found.z[:, 0] ** 2
    assert np.abs(across).max() < 0.1
    exact = laplace_factors(banana, found.z, np.tile(np.eye(3), (len(found.z), 1, 1)))
    across_sd = 1.0 / np.linalg.norm(np.linalg.inv(found.factors), axis=(1, 2))
    expected = 1.0 / np.linalg.norm(np.linalg.inv(exact), axis=(1, 2))
    np.testing.assert_allclose(across_sd, expected, rtol=0.2)


def test_a_walk_along_a_normal_profile_ends_early():
    """The peak's own approximation says the rest: a step or two each way are kept."""

    normal = LeastSquares(lambda z: z / [0.3, 0.1, 0.5])
    found = profiles(normal, peak_of(normal, [0.0, 0.0, 0.0]))
    assert len(found.z) <= 1 + 2 * 6


def test_points_kept_are_the_highest_and_apart():
    z = np.linspace(-1.0, 1.0, 41)[:, None]
    points = Points(z, np.full((41, 1, 1), 0.1), -np.abs(z[:, 0]))
    kept = thinned(points, 5, 1.45)
    np.testing.assert_allclose(np.sort(kept.z[:, 0]), [-0.3, -0.15, 0.0, 0.15, 0.3])
    assert len(thinned(points, 100, 1.45).z) == 13
