"""The joint prior: one law for transform, inverse, density and samples."""

import warnings

import numpy as np
import pytest
from scipy import stats
from tests.shared.priors import (
    ALPHA,
    EVERYTHING,
    FREE,
    MU,
    TAU,
    assert_density_is_jacobian,
    ordered,
)

from deabayes.faults import UserError
from deabayes.prior.distributions import Uniform
from deabayes.prior.from_posterior import MIXTURES
from deabayes.prior.joint import Prior, PriorFromPosterior


@pytest.fixture
def prior():
    return Prior(EVERYTHING)


@pytest.fixture
def posterior_draws():
    """Correlated draws of zeta_alpha and offset."""
    z = np.random.default_rng(3).multivariate_normal(
        [0.5, -1.0], [[0.04, 0.03], [0.03, 0.09]], 4000
    )
    return ("zeta_alpha", "offset"), Prior(FREE[1:]).to_parameters(z)


def test_round_trip(prior):
    z = np.clip(np.random.default_rng(0).standard_normal((4000, len(prior.names))), -4.0, 4.0)
    np.testing.assert_allclose(prior.to_normal(prior.to_parameters(z)), z, atol=1e-10)


def test_density_matches_the_numerical_jacobian(prior):
    assert_density_is_jacobian(
        prior, np.random.default_rng(1).standard_normal((20, len(prior.names)))
    )


def test_density_of_an_inherited_prior_matches_the_numerical_jacobian(prior, posterior_draws):
    inherited = prior.inherit(*posterior_draws)
    assert_density_is_jacobian(
        inherited, np.random.default_rng(2).standard_normal((10, len(prior.names)))
    )


def test_extreme_normals_give_finite_parameters_in_silence(prior):
    rng = np.random.default_rng(4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for size in (8.0, 40.0, 1e5):
            theta = prior.to_parameters(rng.uniform(-size, size, (200, len(prior.names))))
            assert np.all(np.isfinite(theta))
            assert np.all(np.isfinite(prior.to_normal(theta)))
            assert np.all(np.isfinite(prior.log_density(theta)))


def test_outside_the_support():
    prior = Prior((*MU, *ALPHA, *TAU))
    inside = prior.sample(np.random.default_rng(7), 1)[0]
    names = list(prior.names)
    wrong = np.tile(inside, (4, 1))
    wrong[0, names.index("tau_2")] = 1.5 * wrong[0, names.index("tau_1")]
    wrong[1, names.index("tau_3")] = 2000.0
    wrong[2, names.index("mu_1")] *= -1.0
    wrong[3, names.index("alpha_3")] = np.nan
    assert np.isfinite(prior.log_density(inside[None])[0])
    np.testing.assert_array_equal(prior.log_density(wrong), -np.inf)
    assert np.all(np.isnan(prior.to_normal(wrong)).any(axis=1))


def test_half_product_is_positive_whatever_the_exponent():
    prior = Prior((*MU, *ALPHA))
    theta = prior.sample(np.random.default_rng(8), 500)
    assert np.all(theta[:, :3] * theta[:, 3:] > 0.0)
    assert np.any(theta[:, :3] < 0.0)


def test_an_exponent_next_to_zero_is_out_of_the_support_without_a_warning():
    exponent = ordered("alpha", Uniform(0.0, 5.0), unit="1", size=1)
    prior = Prior((MU[0], *exponent))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        theta = prior.to_parameters(np.array([[12.0, -38.0]]))
        assert np.isinf(theta[0, 0])
        assert prior.log_density(theta)[0] == -np.inf


def test_a_draw_does_not_depend_on_its_neighbours(prior):
    z = np.random.default_rng(9).standard_normal((7, len(prior.names)))
    z[3] = np.nan
    theta = prior.to_parameters(z)
    for k in (0, 2, 4, 6):
        np.testing.assert_array_equal(theta[k], prior.to_parameters(z[k : k + 1])[0])


def test_concatenate_joins_parameters_and_ratios():
    joined = Prior.concatenate(Prior(TAU, minimum_ratio=5.0), Prior(FREE))
    assert joined.names == tuple(p.name for p in (*TAU, *FREE))
    theta = joined.sample(np.random.default_rng(10), 50)
    apart = Prior(TAU, minimum_ratio=5.0).log_density(theta[:, :3])
    np.testing.assert_allclose(
        joined.log_density(theta), apart + Prior(FREE).log_density(theta[:, 3:])
    )


class TestInherit:
    def test_mean_and_correlations_are_kept(self, prior, posterior_draws):
        names, draws = posterior_draws
        inherited = prior.inherit(names, draws)
        samples = inherited.sample(np.random.default_rng(11), 20000)
        columns = [prior.names.index(n) for n in names]
        log_zeta, offset = np.log(samples[:, columns[0]]), samples[:, columns[1]]
        expected = np.corrcoef(np.log(draws[:, 0]), draws[:, 1])[0, 1]
        assert expected > 0.3
        assert np.corrcoef(log_zeta, offset)[0, 1] == pytest.approx(expected, abs=0.02)
        assert np.mean(offset) == pytest.approx(draws[:, 1].mean(), abs=0.001)
        assert np.std(log_zeta) == pytest.approx(np.std(np.log(draws[:, 0])), rel=0.03)
        z = np.random.default_rng(12).standard_normal((50, len(prior.names)))
        np.testing.assert_allclose(inherited.to_normal(inherited.to_parameters(z)), z, atol=1e-9)

    def test_two_modes_are_kept_ten_prior_sds_apart_too(self, posterior_draws):
        names, draws = posterior_draws
        bimodal = draws.copy()
        bimodal[::4, 1] += 1.0
        inherited = Prior(FREE).inherit(names, bimodal)
        assert inherited.inherited[0].misfit < 0.03
        assert f"mixture of {2 * MIXTURES} multivariate normals" in inherited.describe("offset")
        offset = inherited.sample(np.random.default_rng(12), 20000)[:, 2]
        assert np.mean(offset > 1.0) == pytest.approx(0.25, abs=0.01)
        assert np.mean(offset[offset > 1.0]) == pytest.approx(draws[:, 1].mean() + 1.0, abs=0.003)

    def test_misfit_tells_what_a_normal_cannot_describe(self, posterior_draws):
        names, draws = posterior_draws
        prior = Prior(FREE)
        assert prior.inherit(names, draws).inherited[0].misfit < 0.03
        few = draws[:39].copy()
        few[::2, 1] += 1.0
        assert prior.inherit(names, few).inherited[0].misfit > 0.1

    def test_a_whole_ordered_group(self):
        prior = Prior((*MU, *ALPHA))
        draws = prior.sample(np.random.default_rng(13), 3000)
        inherited = prior.inherit(*PriorFromPosterior(prior.names, draws))
        samples = inherited.sample(np.random.default_rng(14), 3000)
        for k in range(draws.shape[1]):
            assert stats.ks_2samp(samples[:, k], draws[:, k]).pvalue > 1e-4
        assert "posterior of another study" in inherited.describe("alpha_1")

    @pytest.mark.parametrize(
        ("names", "message"),
        [
            (("elsewhere",), "none of the posterior's parameters"),
            (("tau_1", "tau_2"), "lacks tau_3 of the ordered tau"),
            (("tau_1", "tau_2", "tau_3", "tau_4"), "has tau_4, which this candidate lacks"),
            (("mu_1",), "without alpha_1"),
        ],
    )
    def test_mistakes(self, prior, names, message):
        with pytest.raises(UserError, match=message):
            prior.inherit(names, np.ones((500, len(names))))

    def test_draws_outside_the_support_are_counted(self, prior):
        draws = np.random.default_rng(15).normal(0.0, 1.0, (500, 1))
        with pytest.raises(UserError, match="of 500 draws of zeta_alpha are outside"):
            prior.inherit(("zeta_alpha",), draws)

    def test_too_few_or_constant_draws(self, prior):
        with pytest.raises(UserError, match="at least 10"):
            prior.inherit(("offset",), np.ones((5, 1)))
        with pytest.raises(UserError, match="do not vary"):
            prior.inherit(("offset",), np.ones((50, 1)))


def test_described_in_words(prior):
    assert prior.describe("tau_1") == (
        "log-uniform, lower 0.01, upper 1000, ascending at least a factor 2 apart (tau)"
    )
    assert "half of mu_1 alpha_1" in prior.describe("mu_1")
    assert "factor" not in prior.describe("alpha_1")
