"""Draws as a transform of a standard normal vector, fitted to them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from tests.unit.test_normal_mixture import mixture

from deabayes.prior.from_posterior import PosteriorBlock
from deabayes.prior.normal_mixture import NormalMixture
from deabayes.prior.transport import Transport, distance_from_normal, fit_transport


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


class TestFit:
    NAMES = ("a", "b", "c", "d")

    def test_one_normal_where_it_will_do(self):
        x = mixture(1, 4).colour(np.random.default_rng(9).standard_normal((4000, 4)))
        block = PosteriorBlock.fit(self.NAMES, x)
        assert block.transport.mixture.components == 1
        np.testing.assert_allclose(block.transport.mixture.means[0], x.mean(axis=0))
        np.testing.assert_allclose(
            block.transport.mixture.factors[0], np.linalg.cholesky(np.cov(x.T))
        )
        assert "multivariate normal on" in block.describe()

    def test_a_bent_ridge_is_followed(self):
        rng = np.random.default_rng(10)
        block = PosteriorBlock.fit(self.NAMES, banana(rng, 8000))
        assert block.misfit < 0.05
        assert (
            f"mixture of {block.transport.mixture.components} multivariate normals"
            in block.describe()
        )
        fresh = banana(rng, 4000)
        u = fresh / 0.3
        u = np.stack(
            [u[:, 0], (u[:, 1] - 0.7 * u[:, 0] ** 2) / 0.1, u[:, 2], u[:, 3] / 0.5], axis=1
        )
        exact = np.sum(stats.norm.logpdf(u), axis=1) - 4 * np.log(0.3) - np.log(0.1 * 0.5)
        lost = np.mean(exact - block.transport.mixture.log_density(fresh))
        one = NormalMixture(
            np.ones(1), fresh.mean(axis=0)[None], np.linalg.cholesky(np.cov(fresh.T))[None]
        )
        assert lost < 0.15 < 1.5 < np.mean(exact - one.log_density(fresh))

    def test_no_dips_along_a_bent_ridge(self):
        x = banana(np.random.default_rng(15), 8000)
        block = PosteriorBlock.fit(self.NAMES, x)
        drawn = block.colour(np.random.default_rng(16).standard_normal((40000, 4)))
        ends = stats.norm.ppf(np.linspace(0.02, 0.98, 25))
        counts, expected = np.histogram(drawn[:, 0] / 0.3, ends)[0], 40000 * 0.04
        assert np.sqrt(np.mean((counts / expected - 1.0) ** 2)) < 0.1

    def test_no_more_components_than_draws_left_out_ask_for(self):
        two = mixture(2, 4)
        x = two.colour(np.random.default_rng(17).standard_normal((8000, 4)))
        block = PosteriorBlock.fit(self.NAMES, x)
        assert block.transport.mixture.components == 2

    def test_a_thin_bent_ridge_keeps_its_width(self):
        """Two coordinates that differ by a millionth of what they have in common."""
        x = banana(np.random.default_rng(13), 8000)
        x[:, 2] = x[:, 0] + 1e-6 * x[:, 2]
        block = PosteriorBlock.fit(self.NAMES, x)
        drawn = block.colour(np.random.default_rng(14).standard_normal((4000, 4)))
        assert block.transport.mixture.components > 1
        assert np.std(drawn[:, 2] - drawn[:, 0]) == pytest.approx(0.3e-6, rel=0.1)

    def test_the_same_draws_give_the_same_prior(self):
        x = banana(np.random.default_rng(11), 2000)
        one, other = (PosteriorBlock.fit(self.NAMES, x) for _ in range(2))
        np.testing.assert_array_equal(one.transport.mixture.means, other.transport.mixture.means)

    def test_few_draws_are_not_split(self):
        x = banana(np.random.default_rng(12), 79)
        assert PosteriorBlock.fit(self.NAMES, x).transport.mixture.components == 1


class TestWarped:
    """A ridge that bends so far that a mixture needs many components."""

    @pytest.fixture(scope="class")
    @staticmethod
    def arc() -> tuple[np.ndarray, Transport]:
        x = bow(np.random.default_rng(21), 8000)
        return x, fit_transport(x)

    def test_fewer_components_when_straightened(self, arc):
        _, found = arc
        assert found.warp is not None
        assert found.mixture.components <= 2
        assert "straightened" in found.describe()

    def test_describes_draws_left_out(self, arc):
        """As well as the truth but for a fiftieth of a nat."""
        x = bow(np.random.default_rng(22), 8000)
        u = np.stack([x[:, 0], (x[:, 1] - 0.6 * x[:, 0] ** 2) / 0.03, x[:, 2]], axis=1)
        exact = stats.norm.logpdf(u).sum(axis=1) - np.log(0.03)
        assert np.mean(exact - arc[1].log_density(x)) < 0.02

    def test_there_and_back(self, arc):
        z = np.random.default_rng(23).standard_normal((500, 3))
        np.testing.assert_allclose(arc[1].whiten(arc[1].colour(z)), z, atol=1e-9)

    def test_density_is_that_of_the_transform(self, arc):
        """p(x) = N(z) |dz / dx|, by finite differences."""
        found = arc[1]
        z = np.random.default_rng(24).standard_normal((40, 3))
        x, step = found.colour(z), 1e-6
        slopes = [
            (found.whiten(x + step * e) - found.whiten(x - step * e)) / (2 * step)
            for e in np.eye(3)
        ]
        expected = stats.norm.logpdf(z).sum(axis=1)
        expected += np.linalg.slogdet(np.stack(slopes, axis=2))[1]
        np.testing.assert_allclose(found.log_density(x), expected, atol=1e-4)

    def test_marginal(self, arc):
        x, found = arc
        part = found.marginal([1])
        assert distance_from_normal(part.whiten(x[:, [1]])) < 0.03
        assert distance_from_normal(found.marginal([2]).whiten(x[:, [1]])) > 0.1

    def test_two_modes_are_not_straightened(self):
        two = NormalMixture(
            np.array([0.4, 0.6]), np.array([[-4.0, 0.0], [4.0, 1.0]]), np.stack([np.eye(2)] * 2)
        )
        found = fit_transport(two.colour(np.random.default_rng(25).standard_normal((4000, 2))))
        assert found.warp is None
        assert found.mixture.components == 2


def bow(rng: np.random.Generator, size: int) -> np.ndarray:
    """A thin ridge along a parabola, in three dimensions."""
    u = rng.standard_normal((size, 3))
    return np.stack([u[:, 0], 0.6 * u[:, 0] ** 2 + 0.03 * u[:, 1], u[:, 2]], axis=1)
