"""A mixture of normals as a transform of a standard normal vector."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from deabayes.prior.from_posterior import MIXTURES, PosteriorBlock
from deabayes.prior.learned import distance_from_normal
from deabayes.prior.normal_mixture import NormalMixture


def mixture(components: int, dimension: int, seed: int = 1) -> NormalMixture:
    rng = np.random.default_rng(seed)
    roots = 0.5 * rng.normal(size=(components, dimension, dimension))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.05 * np.eye(dimension)
    return NormalMixture(
        rng.dirichlet(np.full(components, 3.0)),
        2.0 * rng.normal(size=(components, dimension)),
        np.linalg.cholesky(covariances),
    )


@pytest.mark.parametrize("dimension", [1, 4])
def test_there_and_back(dimension):
    one = mixture(1, dimension)
    z = 3.0 * np.random.default_rng(2).standard_normal((200, dimension))
    np.testing.assert_allclose(one.whiten(one.colour(z)), z, atol=1e-10)


@pytest.mark.parametrize("components", [2, 5])
def test_whitened_draws_are_standard_normal(components):
    one = mixture(components, 4)
    x = one.sample(np.random.default_rng(2), 8000)
    assert distance_from_normal(one.whiten(x)) < 0.02


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_far_tails(side):
    """Where one component is all that counts, its own score and the share that it has."""
    one = NormalMixture(np.array([0.3, 0.7]), np.array([[-1.0], [1.0]]), np.full((2, 1, 1), 0.5))
    x = np.array([[side * 12.0]])
    of_nearest = stats.norm.logsf(12.0, 1.0, 0.5) + np.log(0.7 if side > 0.0 else 0.3)
    expected = -side * optimize.brentq(lambda s: stats.norm.logcdf(s) - of_nearest, -40.0, 0.0)
    assert one.whiten(x)[0, 0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("components", [1, 3])
def test_an_infinite_draw_does_not_change_other_draws(components):
    one = mixture(components, 4)
    x = np.random.default_rng(3).normal(size=(5, 4))
    white, density = one.whiten(x), one.log_density(x)
    x[2] = np.inf
    others = np.arange(5) != 2
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(one.whiten(x)[others], white[others])
        np.testing.assert_array_equal(one.log_density(x)[others], density[others])


@pytest.mark.parametrize("components", [1, 3])
def test_density_is_the_weighted_sum(components):
    one = mixture(components, 4)
    x = np.random.default_rng(3).normal(size=(20, 4))
    normals = [
        stats.multivariate_normal(mean, factor @ factor.T).pdf(x)
        for mean, factor in zip(one.means, one.factors, strict=True)
    ]
    np.testing.assert_allclose(one.log_density(x), np.log(one.weights @ normals), rtol=1e-12)


def test_scores_of_one_coordinate():
    one = mixture(3, 1)
    for x in (-2.0, 0.3, 1.7):
        below = float(one.weights @ stats.norm.cdf(x, one.means[:, 0], one.factors[:, 0, 0]))
        assert one.whiten(np.array([[x]]))[0, 0] == pytest.approx(stats.norm.ppf(below), abs=1e-9)


def test_draws_have_the_mixture_s_moments():
    one = mixture(4, 3)
    x = one.sample(np.random.default_rng(4), 200_000)
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
    x = one.sample(np.random.default_rng(15), 200_000)
    whole = one.as_one()
    white = whole.whiten(x)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(white.T), np.eye(3), atol=0.02)


def test_marginal_leaves_the_others_out():
    one = mixture(3, 4)
    x = one.sample(np.random.default_rng(5), 20_000)
    kept = one.marginal([3, 1])
    assert distance_from_normal(kept.whiten(x[:, [3, 1]])) < 0.015
    assert distance_from_normal(kept.whiten(x[:, [1, 3]])) > 0.1


class TestDistance:
    def test_of_normal_draws(self):
        assert distance_from_normal(np.random.default_rng(6).standard_normal((8000, 5))) < 0.02

    def test_of_one_shifted_column(self):
        z = np.random.default_rng(7).standard_normal((8000, 5))
        z[:, 2] += 0.5
        assert distance_from_normal(z) == pytest.approx(2 * stats.norm.cdf(0.25) - 1, abs=0.02)

    def test_of_a_shape_that_no_column_shows(self):
        """Signs shared by all columns: each is standard normal, together they lie in two cones."""
        rng = np.random.default_rng(8)
        z = np.abs(rng.standard_normal(8000))[:, None] * rng.choice([-1.0, 1.0], (8000, 4))
        assert max(stats.kstest(column, "norm").statistic for column in z.T) < 0.02
        assert distance_from_normal(z) > 0.1


def banana(rng: np.random.Generator, size: int) -> np.ndarray:
    """A bent ridge in four dimensions."""
    u = rng.standard_normal((size, 4))
    x = np.stack([u[:, 0], 0.7 * u[:, 0] ** 2 + 0.1 * u[:, 1], u[:, 2], 0.5 * u[:, 3]], axis=1)
    return 0.3 * x


@pytest.fixture(scope="module")
def bent():
    """The prior fitted to draws of a bent ridge."""
    return PosteriorBlock.fit(TestFit.NAMES, banana(np.random.default_rng(15), 8000))


class TestFit:
    NAMES = ("a", "b", "c", "d")

    def test_normal_draws_are_described_by_one_normal(self):
        x = mixture(1, 4).sample(np.random.default_rng(9), 4000)
        block = PosteriorBlock.fit(self.NAMES, x)
        assert block.mixture.components == 1
        np.testing.assert_allclose(block.mixture.means[0], x.mean(axis=0))
        np.testing.assert_allclose(block.mixture.factors[0], np.linalg.cholesky(np.cov(x.T)))
        assert "multivariate normal on" in block.describe()

    def test_a_bent_ridge_is_followed(self, bent):
        assert bent.misfit < 0.05
        assert f"mixture of {bent.mixture.components} multivariate normals" in bent.describe()
        fresh = banana(np.random.default_rng(18), 4000)
        u = fresh / 0.3
        u = np.stack(
            [u[:, 0], (u[:, 1] - 0.7 * u[:, 0] ** 2) / 0.1, u[:, 2], u[:, 3] / 0.5], axis=1
        )
        exact = np.sum(stats.norm.logpdf(u), axis=1) - 4 * np.log(0.3) - np.log(0.1 * 0.5)
        lost = np.mean(exact - bent.mixture.log_density(fresh))
        one = NormalMixture(
            np.ones(1), fresh.mean(axis=0)[None], np.linalg.cholesky(np.cov(fresh.T))[None]
        )
        assert lost < 0.15 < 1.5 < np.mean(exact - one.log_density(fresh))

    def test_the_density_has_no_dips_along_a_bent_ridge(self, bent):
        drawn = bent.mixture.sample(np.random.default_rng(16), 40000)
        ends = stats.norm.ppf(np.linspace(0.02, 0.98, 25))
        counts, expected = np.histogram(drawn[:, 0] / 0.3, ends)[0], 40000 * 0.04
        assert np.sqrt(np.mean((counts / expected - 1.0) ** 2)) < 0.1

    def test_the_number_of_components_is_that_of_the_draws(self):
        two = mixture(2, 4)
        x = two.sample(np.random.default_rng(17), 8000)
        block = PosteriorBlock.fit(self.NAMES, x)
        assert block.mixture.components == 2 * MIXTURES

    def test_a_thin_bent_ridge_keeps_its_width(self):
        """Two coordinates that differ by a millionth of what they have in common."""
        x = banana(np.random.default_rng(13), 4000)
        x[:, 2] = x[:, 0] + 1e-6 * x[:, 2]
        block = PosteriorBlock.fit(self.NAMES, x)
        drawn = block.mixture.sample(np.random.default_rng(14), 4000)
        assert block.mixture.components > 1
        assert np.std(drawn[:, 2] - drawn[:, 0]) == pytest.approx(0.3e-6, rel=0.1)

    def test_the_same_draws_give_the_same_prior(self):
        x = banana(np.random.default_rng(11), 1000)
        one, other = (PosteriorBlock.fit(self.NAMES, x) for _ in range(2))
        np.testing.assert_array_equal(one.mixture.means, other.mixture.means)

    def test_few_draws_are_not_split(self):
        x = banana(np.random.default_rng(12), 79)
        assert PosteriorBlock.fit(self.NAMES, x).mixture.components == 1
