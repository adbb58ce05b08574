"""Bands are quantiles of the mixture of the draws' laws: exact, one around the other, smooth."""

import numpy as np
import pytest
from scipy import stats
from tests.statistical.test_noise_sampling import truth

from deabayes.inference.record_noise import ResidualScale
from deabayes.noise import REGISTRY
from deabayes.prediction import bands as prediction_bands
from deabayes.prediction.bands import TAILS, bands, mixture_quantile

SIZE = 300
WEIGHTS = np.array([1.0, 0.1, 1.0, 0.25, 1.0, 1.0, 0.5])
ALONG = np.linspace(0.0, 3.0, WEIGHTS.size)


def curves(seed=1):
    """Skewed draws of positive curves, their spread growing along the record."""
    theta = np.random.default_rng(seed).gamma(2.0, 0.1, SIZE)[:, None]
    return 2.0 + np.sin(ALONG) + theta * (1.0 + ALONG)


def noise_draws(size=SIZE, **values):
    draws = {"sigma_white": 0.02, "sigma_ou": 0.4, "tau_ou": 1.0, **values}
    spread = np.exp(0.3 * np.random.default_rng(2).standard_normal(size))
    return {name: value * spread for name, value in draws.items()}


@pytest.mark.parametrize("name", REGISTRY)
def test_one_residual_has_the_law_that_samples_have(name):
    """Kolmogorov-Smirnov tests of both parts; a scale 5 % off fails."""
    draws, noise = truth(name), REGISTRY[name]()
    parts = noise.sample(np.random.default_rng(1), ALONG, WEIGHTS, draws)
    for part, spread in zip((parts[0], sum(parts)), noise.spreads(draws, WEIGHTS), strict=True):
        spread = np.broadcast_to(spread, part.shape)
        if not spread.any():
            assert not part.any()
            continue
        for off, passes in ((1.0, True), (1.05, False)):
            shares = noise.cumulative(part / spread / off, draws)
            p = min(stats.kstest(shares[:, k], "uniform").pvalue for k in range(WEIGHTS.size))
            assert (p > 1e-3) == passes, (name, off, p)


@pytest.mark.parametrize("proportional", [False, True])
def test_the_share_below_an_edge_is_the_one_asked(proportional):
    mean, draws = curves(), noise_draws()
    scale = ResidualScale(np.linspace(0.5, 1.0, SIZE), proportional)
    found = bands(mean, scale, REGISTRY["ornstein_uhlenbeck"](), draws, WEIGHTS)
    white, correlated = (draws[n][:, None] ** 2 for n in ("sigma_white", "sigma_ou"))
    for name, variance in (
        ("discrepancy", correlated),
        ("predictive", correlated + white * WEIGHTS),
    ):
        for edges, shares in zip(found[name], TAILS, strict=True):
            for edge, share in zip(edges, shares, strict=True):
                scores = scale.residuals(edge, mean) / np.sqrt(variance)
                np.testing.assert_allclose(stats.norm.cdf(scores).mean(axis=0), share, atol=1e-7)


def test_students_law_has_the_tails_that_its_degrees_of_freedom_say():
    draws = {"sigma_white": np.full(4, 0.1), "degrees_of_freedom": np.full(4, 1.5)}
    mean = np.full((4, WEIGHTS.size), 2.0)
    found = bands(mean, ResidualScale(), REGISTRY["student_t"](), draws, WEIGHTS)
    expected = 2.0 + 0.1 * np.sqrt(WEIGHTS) * stats.t(1.5).ppf(0.95)
    np.testing.assert_allclose(found["predictive"][1, 1], expected, rtol=1e-6)
    np.testing.assert_array_equal(found["discrepancy"], found["parameter"])


@pytest.mark.parametrize("white", [1e-9, 1e-4, 0.02])
@pytest.mark.parametrize("correlated", [1e-6, 1e-3, 0.4])
def test_each_band_lies_around_the_one_before_it(white, correlated):
    draws = noise_draws(sigma_white=white, sigma_ou=correlated)
    found = bands(curves(), ResidualScale(), REGISTRY["ornstein_uhlenbeck"](), draws, WEIGHTS)
    for inner, outer in (("parameter", "discrepancy"), ("discrepancy", "predictive")):
        assert np.all(found[outer][:, 0] <= found[inner][:, 0])
        assert np.all(found[outer][:, 1] >= found[inner][:, 1])


def test_edges_are_as_smooth_as_the_curves():
    """Second differences along a fine grid; of samples they are a thousand times those."""
    mean = np.random.default_rng(1).normal(1.0, 0.1, (SIZE, 1)) * np.sin(np.linspace(0, 1, 200))
    draws, noise = noise_draws(), REGISTRY["ornstein_uhlenbeck"]()
    found = bands(mean, ResidualScale(), noise, draws, np.ones(200))["predictive"]
    assert np.abs(np.diff(found, 2)).max() < 1e-3 * np.ptp(found)


def test_a_record_in_pieces_has_the_same_bands(monkeypatch):
    given = (
        curves(),
        ResidualScale(),
        REGISTRY["matern32"](),
        noise_draws(sigma_matern=0.3, tau_matern=0.1),
        WEIGHTS,
    )
    whole = bands(*given)
    monkeypatch.setattr(prediction_bands, "AT_ONCE", 2 * SIZE)
    for name, found in bands(*given).items():
        np.testing.assert_allclose(found, whole[name], rtol=1e-7)


def test_two_far_modes_and_unknown_points():
    """The third quarter of two narrow modes is the upper one's median; a NaN stays at its point."""
    location = np.repeat([[0.0], [100.0]], 50, axis=0) * np.ones(3)
    spread = np.ones((100, 3))
    spread[7, 1] = np.nan
    found = mixture_quantile(location, spread, 0.75, stats.norm.cdf)
    np.testing.assert_allclose(found, [100.0, np.nan, 100.0], atol=1e-5)
