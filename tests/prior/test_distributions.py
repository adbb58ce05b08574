"""Distributions: transform, inverse and density belong to one law, in both tails."""

import math
import warnings

import numpy as np
import pytest
from scipy import stats

from deabayes.faults import UserError
from deabayes.prior.distributions import (
    REGISTRY,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)
from deabayes.prior.overrides import from_settings

CASES = [
    (Normal(1.0, 2.0), stats.norm(1.0, 2.0)),
    (LogNormal(35e3, 0.5), stats.lognorm(0.5, scale=35e3)),
    (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    (LogUniform(1e-2, 1e4), stats.loguniform(1e-2, 1e4)),
    (HalfNormal(2.0), stats.halfnorm(scale=2.0)),
    (TruncatedNormal(1.0, 2.0, 0.0, 9.0), stats.truncnorm(-0.5, 4.0, loc=1.0, scale=2.0)),
    (TruncatedNormal(0.0, 1.0, 5.0, 6.0), stats.truncnorm(5.0, 6.0)),
    (TruncatedNormal(0.0, 1.0, -6.0, -5.0), stats.truncnorm(-6.0, -5.0)),
    (TruncatedNormal(3.0, 0.1, 2.9), stats.truncnorm(-1.0, np.inf, loc=3.0, scale=0.1)),
]
IDENTITIES = [repr(case[0]) for case in CASES]


def test_every_registered_distribution_is_tested():
    assert set(REGISTRY.values()) == {type(distribution) for distribution, _ in CASES}


@pytest.mark.parametrize(("distribution", "oracle"), CASES, ids=IDENTITIES)
class TestLaw:
    def test_quantiles(self, distribution, oracle):
        z = np.linspace(-5.0, 5.0, 21)
        np.testing.assert_allclose(
            distribution.from_normal(z), oracle.ppf(stats.norm.cdf(z)), rtol=1e-6, atol=1e-12
        )

    def test_inverse(self, distribution, oracle):
        z = np.linspace(-4.0, 4.0, 33)
        np.testing.assert_allclose(
            distribution.to_normal(distribution.from_normal(z)), z, atol=1e-10
        )

    def test_density(self, distribution, oracle):
        x = distribution.from_normal(np.linspace(-3.0, 3.0, 13))
        np.testing.assert_allclose(distribution.log_density(x), oracle.logpdf(x), rtol=1e-9)

    def test_density_is_the_jacobian_of_the_transform(self, distribution, oracle):
        z, step = np.linspace(-3.0, 3.0, 13), 1e-5
        slope = distribution.from_normal(z + step) - distribution.from_normal(z - step)
        log_density = stats.norm.logpdf(z) - np.log(slope / (2.0 * step))
        x = distribution.from_normal(z)
        np.testing.assert_allclose(distribution.log_density(x), log_density, rtol=1e-6, atol=1e-6)

    def test_extreme_values_are_finite_and_silent(self, distribution, oracle):
        z = np.array([-1e5, -40.0, -9.0, 9.0, 40.0, 1e5])
        lower, upper = distribution.support
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            x = distribution.from_normal(z)
            assert np.all(np.isfinite(x))
            assert np.all(np.diff(x) >= 0.0)
            assert np.all((x >= lower) & (x <= upper))
            assert np.all(np.isfinite(distribution.to_normal(x)))
            assert not np.any(np.isnan(distribution.log_density(x)))

    def test_outside_the_support(self, distribution, oracle):
        ends = [end for end in distribution.support if math.isfinite(end)]
        outside = np.array(
            [end + (-1.0 if end == distribution.support[0] else 1.0) for end in ends]
        )
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert np.all(np.isneginf(distribution.log_density(outside)))
            assert np.all(np.isnan(distribution.to_normal(outside)))
            for method in (distribution.from_normal, distribution.to_normal):
                assert np.isnan(method(np.nan))
            assert np.isnan(distribution.log_density(np.nan))


def test_tails_are_accurate_where_floating_point_resolves_them():
    z = np.linspace(-8.0, 8.0, 65)
    lower = z[z < 0.0]
    np.testing.assert_allclose(Uniform(0.0, 1.0).from_normal(lower), stats.norm.cdf(lower))
    np.testing.assert_allclose(
        Uniform(0.0, 1.0).to_normal(stats.norm.cdf(lower)), lower, rtol=1e-12
    )
    np.testing.assert_array_equal(
        Uniform(-1.0, 0.0).from_normal(-lower), -Uniform(0.0, 1.0).from_normal(lower)
    )
    assert TruncatedNormal(0.0, 1.0, -1.0).to_normal(40.0) == pytest.approx(40.0, abs=0.01)
    half, truncated = HalfNormal(2.0), TruncatedNormal(0.0, 2.0, 0.0)
    np.testing.assert_allclose(half.to_normal(half.from_normal(z)), z, atol=1e-10)
    np.testing.assert_allclose(truncated.from_normal(z), half.from_normal(z), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(half.from_normal(8.0), 2.0 * stats.norm.isf(stats.norm.sf(8.0) / 2))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LogNormal(0.0, 1.0), "median must be positive"),
        (lambda: LogNormal(1.0, -1.0), "sigma must be positive"),
        (lambda: Normal(0.0, 0.0), "sd must be positive"),
        (lambda: Normal(math.nan, 1.0), "mean must be finite"),
        (lambda: Uniform(1.0, 1.0), "lower must be below upper"),
        (lambda: LogUniform(0.0, 1.0), "lower must be positive"),
        (lambda: HalfNormal(-1.0), "sd must be positive"),
        (lambda: TruncatedNormal(0.0, 1.0, 2.0, 1.0), "lower must be below upper"),
    ],
)
def test_impossible_settings(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_described_in_words():
    assert LogNormal(35e3, 0.5).describe() == "log-normal, median 35e3, sigma 0.5"
    assert Uniform(-5.0, 1e-4).describe() == "uniform, lower -5, upper 100e-6"


class TestFromSettings:
    def test_units_are_converted(self):
        settings = {"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}
        assert from_settings(settings, "Pa", "priors.mu_alpha") == LogNormal(35e3, 0.5)

    def test_numbers_are_si_even_as_text(self):
        settings = {"distribution": "loguniform", "lower": "1e-3", "upper": 10}
        assert from_settings(settings, "s", "priors.tau") == LogUniform(1e-3, 10.0)

    def test_truncation_may_be_one_sided(self):
        settings = {"distribution": "truncated_normal", "mean": 0, "sd": 1, "lower": 0}
        assert from_settings(settings, "1", "priors.x") == TruncatedNormal(0.0, 1.0, 0.0)

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"distribution": "lognorml", "median": 1, "sigma": 1}, "did you mean 'lognormal'"),
            ({"median": 1, "sigma": 1}, "unknown distribution None"),
            ({"distribution": "lognormal", "median": 1}, "no sigma; add sigma"),
            ({"distribution": "lognormal", "medain": 1, "sigma": 1}, "did you mean 'median'"),
            ({"distribution": "lognormal", "median": "3 V", "sigma": 1}, "median.*a voltage"),
            ({"distribution": "lognormal", "median": -1, "sigma": 1}, "must be positive"),
            ({"distribution": "lognormal", "median": True, "sigma": 1}, "found True"),
            ({"distribution": "lognormal", "median": [1], "sigma": 1}, r"found \[1\]"),
            ({"distribution": "lognormal", "median": 1, "sigma": "2 Pa"}, "sigma.*a stress"),
            ("lognormal", "expected a mapping"),
        ],
    )
    def test_mistakes_name_the_key(self, settings, message):
        with pytest.raises(UserError, match=message) as fault:
            from_settings(settings, "Pa", "priors.mu_alpha")
        assert "priors.mu_alpha" in str(fault.value)
