"""A mixture of normals as a transform of a standard normal vector."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from deabayes.prior.normal_mixture import NormalMixture
from deabayes.prior.transport import distance_from_normal


def mixture(components: int, dimension: int, seed: int = 1) -> NormalMixture:
    rng = np.random.default_rng(seed)
    roots = 0.5 * rng.normal(size=(components, dimension, dimension))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.05 * np.eye(dimension)
    return NormalMixture(
        rng.dirichlet(np.full(components, 3.0)),
        2.0 * rng.normal(size=(components, dimension)),
        np.linalg.cholesky(covariances),
    )


@pytest.mark.parametrize("components", [1, 2, 5])
@pytest.mark.parametrize("dimension", [1, 4])
def test_there_and_back(components, dimension):
    one = mixture(components, dimension)
    z = 3.0 * np.random.default_rng(2).standard_normal((200, dimension))
    np.testing.assert_allclose(one.whiten(one.colour(z)), z, atol=1e-10)


@pytest.mark.parametrize("score", [-30.0, -9.0, 0.0, 9.0, 30.0])
def test_far_tails(score):
    one = mixture(3, 2)
    z = np.array([[score, 0.0], [0.0, score], [score, -score]])
    np.testing.assert_allclose(one.whiten(one.colour(z)), z, atol=1e-9)


def test_components_far_apart():
    one = NormalMixture(np.array([0.3, 0.7]), np.array([[-1e3], [1e3]]), np.full((2, 1, 1), 1e-3))
    z = stats.norm.ppf(np.array([[0.1], [0.3 - 1e-9], [0.3 + 1e-9], [0.9]]))
    x = one.colour(z)
    np.testing.assert_allclose(one.whiten(x), z, atol=1e-9)
    assert np.all(np.abs(np.abs(x) - 1e3) < 0.01)


def test_density_is_the_weighted_sum():
    one = mixture(3, 4)
    x = np.random.default_rng(3).normal(size=(20, 4))
    normals = [
        stats.multivariate_normal(mean, factor @ factor.T).pdf(x)
        for mean, factor in zip(one.means, one.factors, strict=True)
    ]
    np.testing.assert_allclose(one.log_density(x), np.log(one.weights @ normals), rtol=1e-12)


def test_quantiles_of_one_coordinate():
    one = mixture(3, 1)

    def share_below(x: float) -> float:
        return float(one.weights @ stats.norm.cdf(x, one.means[:, 0], one.factors[:, 0, 0]))

    for score in (-2.0, 0.3, 1.7):
        below = stats.norm.cdf(score)
        expected = optimize.brentq(lambda x, p=below: share_below(x) - p, -20, 20)
        assert one.colour(np.array([[score]]))[0, 0] == pytest.approx(expected, abs=1e-10)


def test_draws_have_the_mixture_s_moments():
    one = mixture(4, 3)
    x = one.colour(np.random.default_rng(4).standard_normal((200_000, 3)))
    mean = one.weights @ one.means
    second = np.einsum(
        "j,jab->ab", one.weights, one.factors @ one.factors.transpose(0, 2, 1)
    ) + np.einsum("j,ja,jb->ab", one.weights, one.means, one.means)
    spread = np.sqrt(np.diag(second - np.outer(mean, mean)))
    np.testing.assert_allclose(x.mean(axis=0), mean, atol=0.01 * spread.max())
    np.testing.assert_allclose(
        np.cov(x.T), second - np.outer(mean, mean), atol=0.02 * spread.max() ** 2
    )


def test_as_one_normal():
    one = mixture(4, 3)
    x = one.colour(np.random.default_rng(15).standard_normal((200_000, 3)))
    whole = one.as_one()
    white = whole.whiten(x)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(white.T), np.eye(3), atol=0.02)


def test_marginal_leaves_the_others_out():
    one = mixture(3, 4)
    x = one.colour(np.random.default_rng(5).standard_normal((20_000, 4)))
    kept = one.marginal([3, 1])
    assert distance_from_normal(kept.whiten(x[:, [3, 1]])) < 0.015
    assert distance_from_normal(kept.whiten(x[:, [1, 3]])) > 0.1
