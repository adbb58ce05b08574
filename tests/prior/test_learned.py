"""What draws of a posterior have learned: against likelihoods that are known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from tests.systems.test_film_terms import film

from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.inheritance import GROUP, inherited_prior, with_inherited_prior
from deabayes.prior.distributions import Normal
from deabayes.prior.from_posterior import PosteriorBlock
from deabayes.prior.joint import Prior
from deabayes.prior.learned import Learned, Shown, distance
from deabayes.prior.parameter import Parameter
from deabayes.systems.ridges.units import UnitHop

FILM = ("mu_1", "mu_2", "alpha_1", "alpha_2", "relative_permittivity")
CANDIDATES = 400_000
WIDTH = 0.3
"""Of the stress at each of five stretches, of itself, and 1 of the permittivity's score."""


def log_likelihood(prior: Prior, theta: np.ndarray) -> np.ndarray:
    """Normal in what forces show of a film, about two terms of exponents 1 and 4."""
    shown = Shown.by([prior.parameters[prior.names.index(name)] for name in FILM])
    columns = [prior.names.index(name) for name in FILM]
    centre = [[4e5, 1e3, 1.0, 4.0, 2.0]]
    features = shown(theta[:, columns], prior.to_normal(theta)[:, columns])
    about = shown(np.array(centre), np.zeros((1, len(FILM))))
    widths = np.append(WIDTH * about[0, :5], 1.0)
    return -0.5 * np.sum(((features - about) / widths) ** 2, axis=1)


@cache
def handed_on() -> tuple[LogPosterior, Prior, np.ndarray, float]:
    """A film, its prior with the posterior of exact draws, these, and the log evidence."""
    posterior = film("ogden_2")
    prior = posterior.prior
    rng = np.random.default_rng(1)
    theta = prior.sample(rng, CANDIDATES)
    log_l = log_likelihood(prior, theta)
    kept = np.log(rng.random(CANDIDATES)) < log_l
    columns = [prior.names.index(name) for name in FILM]
    evidence = float(np.log(np.mean(np.exp(log_l))))
    inherited = prior.inherit(FILM, theta[kept][:, columns])
    return posterior, inherited, theta[kept], evidence


def errors_of(prior: Prior) -> np.ndarray:
    """Of the log density of draws, (S,): the default prior's parts cancel."""
    posterior, _, theta, evidence = handed_on()
    found = prior.log_density(theta) - posterior.prior.log_density(theta)
    return found - (log_likelihood(posterior.prior, theta) - evidence)


def without_learning(prior: Prior) -> Prior:
    (block,) = prior.inherited
    mixture = PosteriorBlock(block.names, block.mixture, 0.0)
    return Prior(prior.parameters, prior.minimum_ratios, (mixture,))


def test_a_films_likelihood_is_found_to_the_rim() -> None:
    _, prior, theta, _ = handed_on()
    assert len(theta) > 3000
    assert prior.inherited[0].learned is not None
    errors = errors_of(prior)
    assert abs(errors.mean()) < 0.05
    assert errors.std() < 0.12
    rim = np.argsort(log_likelihood(handed_on()[0].prior, theta))[: len(theta) // 50]
    assert np.abs(errors[rim]).mean() < 0.3
    assert errors_of(without_learning(prior)).std() > 2.0 * errors.std()


def test_draws_of_the_inherited_prior_are_like_the_posteriors_draws() -> None:
    _, prior, theta, _ = handed_on()
    drawn = prior.sample(np.random.default_rng(3), len(theta))
    for name in FILM:
        column = prior.names.index(name)
        assert stats.ks_2samp(drawn[:, column], theta[:, column]).statistic < 0.05
    assert prior.inherited[0].misfit < 0.05


def test_draws_of_the_prior_are_weighted() -> None:
    """Chosen from those of one normal, which are no good without their weights."""
    _, prior, theta, _ = handed_on()
    (block,) = prior.inherited
    poor = replace(block, mixture=block.mixture.as_one())
    one = Prior(prior.parameters, prior.minimum_ratios, (poor,))
    columns = [prior.names.index(name) for name in block.names]
    assert block.learned is not None
    before = _shown(block.learned, theta[:, columns])
    weighted = one.sample(np.random.default_rng(3), 20_000)
    z = np.random.default_rng(3).standard_normal((20_000, theta.shape[1]))
    gaps = [
        distance(before, _shown(block.learned, each[:, columns]), np.ones(len(each)))
        for each in (weighted, one.to_parameters(z))
    ]
    assert gaps[0] < 0.05
    assert gaps[1] > 0.1


def _shown(learned: Learned, theta: np.ndarray) -> np.ndarray:
    """The film's part of it, which needs no scores."""
    return learned.shown(theta, np.zeros_like(theta))[:, :-1]


def test_the_density_in_z_is_that_of_the_parameters() -> None:
    """N(z) p/q = p(theta) |d theta / d z|, by finite differences."""
    posterior, prior, _, _ = handed_on()
    z = 0.7 * np.random.default_rng(4).standard_normal((20, len(prior.names)))
    theta, step = prior.to_parameters(z), 1e-6  # near thin normals it bends
    columns = [
        (prior.to_parameters(z + step * e) - prior.to_parameters(z - step * e)) / (2.0 * step)
        for e in np.eye(len(prior.names))
    ]
    log_jacobian = np.linalg.slogdet(np.stack(columns, axis=2))[1]
    normal = stats.norm.logpdf(z).sum(axis=1)
    expected = prior.log_density(theta) + log_jacobian
    np.testing.assert_allclose(normal + prior.log_correction(theta, z), expected, atol=1e-3)
    expected += posterior.log_likelihood(theta)
    np.testing.assert_allclose(replace(posterior, prior=prior)(z), expected, atol=1e-3)


def test_hops_between_units_keep_the_learned_prior() -> None:
    """Where the target is the prior alone: L is p/q."""
    _, prior, theta, _ = handed_on()
    hop, rng = UnitHop.of(prior), np.random.default_rng(5)
    assert hop is not None
    start = prior.sample(rng, 8000)
    z, accepted = prior.to_normal(start), 0.0
    for _ in range(20):
        proposed, factor = hop(z, rng)
        log_target = [
            prior.log_correction(prior.to_parameters(each), each) - 0.5 * (each**2).sum(axis=1)
            for each in (z, proposed)
        ]
        moved = np.log(rng.random(len(z))) < factor + log_target[1] - log_target[0]
        z[moved] = proposed[moved]
        accepted += moved.mean() / 20
    assert accepted > 0.05
    after = prior.to_parameters(z)
    for name in FILM:
        column = prior.names.index(name)
        assert stats.ks_2samp(after[:, column], theta[:, column]).statistic < 0.05


def test_two_modes_are_described_by_a_mixture() -> None:
    """No quadratic has two maxima."""
    prior = Prior([Parameter(n, n, "1", "", Normal(0.0, 1.0), "") for n in "ab"])
    draws = 0.2 * np.random.default_rng(6).standard_normal((4000, 2))
    draws[::2] += 1.0
    (block,) = prior.inherit(("a", "b"), draws).inherited
    assert block.mixture.components > 1
    assert block.learned is None
    inherited = prior.inherit(("a", "b"), draws)
    z = inherited.to_normal(draws)
    made = stats.norm.logpdf(z).sum(axis=1) - inherited.log_density(draws)
    ratio = inherited.log_correction(draws, z) + made  # of volumes alone: base is one normal
    np.testing.assert_allclose(ratio, ratio[0], atol=1e-9)


def test_parameters_between_two_modes_have_coordinates() -> None:
    """A mixture's quantiles jump from one to the other: no z led to where records pulled."""
    prior = Prior([Parameter("a", "a", "1", "", Normal(0.0, 1.0), "")])
    draws = 0.1 * np.random.default_rng(6).standard_normal((4000, 1))
    draws[::2] += 2.0
    inherited = prior.inherit(("a",), draws - 1.0)
    between = np.linspace(-0.5, 0.5, 41)[:, None]
    back = inherited.to_parameters(inherited.to_normal(between))
    np.testing.assert_allclose(back, between, atol=1e-9)
    found = inherited.sample(np.random.default_rng(1), 4000)
    assert np.mean(found > 0.0) == pytest.approx(0.5, abs=0.04)
    assert np.abs(np.abs(found) - 1.0).max() < 0.6


def test_some_of_the_parameters_have_the_mixtures_marginal() -> None:
    _, prior, _, _ = handed_on()
    (block,) = prior.inherited
    assert block.of(FILM).learned is block.learned
    assert block.of(FILM[:3]).learned is None


def test_a_film_without_all_of_its_terms_has_other_features() -> None:
    parameters = {p.name: p for p in film("ogden_2").prior.parameters}
    shown = Shown.by([parameters[n] for n in ("mu_2", "alpha_2", "relative_permittivity")])
    assert shown.scores == (2,)
    assert [s.coefficients for s in shown.series] == [(0,)]
    assert Shown.by([parameters["mu_1"], parameters["alpha_2"]]) == Shown((), (0, 1))


def test_a_normal_likelihood_is_learned_from_a_wider_normal() -> None:
    rng = np.random.default_rng(7)
    mean, sd = np.array([0.5, -1.0]), np.array([0.3, 0.6])
    draws = mean + sd * rng.standard_normal((6000, 2))
    others = mean + rng.standard_normal((24_000, 2))
    wide = stats.multivariate_normal(mean, np.eye(2)).logpdf
    found = Learned.of(
        Shown((), (0, 1)), (draws, draws), (others, others), (wide(draws), wide(others))
    )
    at = draws[:200]
    log_density = found(at, at) + stats.norm.logpdf(at).sum(axis=1)
    exact = stats.norm.logpdf(at, mean, sd).sum(axis=1)
    np.testing.assert_allclose(log_density, exact, atol=0.15)
    assert np.abs(log_density - exact).mean() < 0.03


def test_a_learned_likelihood_does_not_rise_without_end() -> None:
    """Draws of a direction that nothing was learned of: its curvature would be chance's."""
    rng = np.random.default_rng(9)
    draws, others = rng.standard_normal((2000, 2)), rng.standard_normal((8000, 2))
    draws[:, 0] = 0.5 + 0.1 * draws[:, 0]
    others[:, 0] = 0.5 + 0.2 * others[:, 0]
    q = stats.multivariate_normal([0.5, 0.0], [[0.04, 0.0], [0.0, 1.0]]).logpdf
    found = Learned.of(Shown((), (0, 1)), (draws, draws), (others, others), (q(draws), q(others)))
    far = np.array([[0.5, 0.0], [0.5, 30.0], [0.5, -30.0]])
    levels = found(far, far)
    assert levels[1:].max() - levels[0] < 3.0  # linear terms are chance's still
    np.testing.assert_allclose(
        found(draws, draws).mean(), np.log(10.0) - 0.5 + 0.5 * 0.26, atol=0.1
    )


def test_distance_of_weighted_draws() -> None:
    rng = np.random.default_rng(8)
    others = rng.uniform(-3.0, 3.0, (40_000, 1))
    weights = stats.norm.pdf(others[:, 0])
    assert distance(rng.standard_normal((4000, 1)), others, weights) < 0.03
    assert distance(rng.standard_normal((4000, 1)) + 0.3, others, weights) > 0.1


def test_a_posterior_file_stores_the_learned_prior() -> None:
    posterior, prior, theta, _ = handed_on()
    held = xr.DataTree.from_dict({GROUP: inherited_prior(replace(posterior, prior=prior))})
    found = with_inherited_prior(posterior, held).prior
    theta, z = theta[:50], prior.to_normal(theta[:50])
    assert found.log_correction(theta, z).any()
    np.testing.assert_array_equal(found.log_correction(theta, z), prior.log_correction(theta, z))
    assert found.describe("mu_1") == prior.describe("mu_1")
    assert "learned from its draws" in found.describe("mu_1")


def test_far_out_the_density_is_that_of_z_not_of_rounded_parameters() -> None:
    """An exponent at its bound is that number from a score of 9 on; N(0, 1) falls further."""
    _, prior, theta, _ = handed_on()
    (block,) = prior.inherited
    film = [prior.names.index(name) for name in block.names]
    exponents = [k for k, name in enumerate(block.names) if name.startswith("alpha")]
    start = np.median(prior.to_normal(theta), axis=0)
    scores = np.repeat(block.base.colour(start[None, film]), 3, axis=0)
    for column in exponents:
        far = scores.copy()
        far[:, column] = -9.0, -12.0, -15.0
        z = np.repeat(start[None], 3, axis=0)
        z[:, film] = block.base.whiten(far)
        found = prior.to_parameters(z)
        np.testing.assert_allclose(found, np.repeat(found[:1], 3, axis=0), rtol=1e-6)
        log_density = stats.norm.logpdf(z).sum(axis=1) + prior.log_correction(found, z)
        np.testing.assert_allclose(np.diff(log_density), [-31.5, -40.5], atol=1e-3)
