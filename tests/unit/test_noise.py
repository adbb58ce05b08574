"""Noise models against dense covariances, celerite2 and one another."""

import warnings

import numpy as np
import pytest
from scipy import stats
from tests.unit.noise_oracle import GAUSSIAN, covariance

from deabayes.faults import UserError
from deabayes.noise import REGISTRY
from deabayes.noise.kalman_lanes import LANES

RELATIVE = 1e-8


def make_draws(name, size, rng):
    """Draws over a wide range of the model's parameters."""
    draws = {}
    for parameter in REGISTRY[name]().parameters("1", 1.0, 100.0):
        middle = {"s": 3.0, "1": 0.5}[parameter.unit]
        if parameter.name == "degrees_of_freedom":
            middle = 5.0
        draws[parameter.name] = middle * np.exp(rng.normal(0.0, 1.0, size))
    return draws


def record(rng, size=60, grid="irregular"):
    """Coordinate and weights of a record."""
    if grid == "regular":
        return 0.1 * np.arange(size), np.ones(size)
    return np.sort(rng.uniform(0.0, 50.0, size)), 1.0 / rng.integers(1, 30, size)


def one(draws, k):
    return {name: values[k] for name, values in draws.items()}


@pytest.mark.parametrize("grid", ["irregular", "regular"])
@pytest.mark.parametrize("name", GAUSSIAN)
def test_dense_covariance(name, grid):
    rng = np.random.default_rng(1)
    coordinate, weights = record(rng, grid=grid)
    draws = make_draws(name, 40, rng)
    residuals = rng.normal(0.0, 0.5, (40, coordinate.size))
    model = REGISTRY[name]()
    expected = [
        stats.multivariate_normal.logpdf(
            residuals[k], cov=covariance(name, coordinate, weights, one(draws, k))
        )
        for k in range(40)
    ]
    log_prob = model.log_prob(residuals, coordinate, weights, draws)
    pointwise = model.pointwise_log_prob(residuals, coordinate, weights, draws)
    np.testing.assert_allclose(log_prob, expected, rtol=RELATIVE)
    np.testing.assert_allclose(pointwise.sum(axis=1), expected, rtol=RELATIVE)


def test_celerite2():
    celerite2 = pytest.importorskip("celerite2")
    rng = np.random.default_rng(2)
    coordinate, weights = record(rng, 2000)
    draws = make_draws("ornstein_uhlenbeck", 5, rng)
    residuals = rng.normal(0.0, 0.5, (5, 2000))
    found = REGISTRY["ornstein_uhlenbeck"]().log_prob(residuals, coordinate, weights, draws)
    for k in range(5):
        draw = one(draws, k)
        term = celerite2.terms.RealTerm(a=draw["sigma_ou"] ** 2, c=1.0 / draw["tau_ou"])
        process = celerite2.GaussianProcess(term)
        process.compute(coordinate, diag=draw["sigma_white"] ** 2 * weights)
        assert found[k] == pytest.approx(process.log_likelihood(residuals[k]), rel=RELATIVE)


def test_student_t_against_scipy():
    rng = np.random.default_rng(3)
    coordinate, weights = record(rng)
    draws = make_draws("student_t", 8, rng)
    residuals = rng.standard_t(3.0, (8, coordinate.size))
    expected = stats.t.logpdf(
        residuals,
        draws["degrees_of_freedom"][:, None],
        scale=draws["sigma_white"][:, None] * np.sqrt(weights),
    )
    model = REGISTRY["student_t"]()
    np.testing.assert_allclose(
        model.pointwise_log_prob(residuals, coordinate, weights, draws), expected, rtol=RELATIVE
    )
    probability = stats.t.cdf(
        residuals,
        draws["degrees_of_freedom"][:, None],
        scale=draws["sigma_white"][:, None] * np.sqrt(weights),
    )
    near = np.abs(probability - 0.5) < 0.499
    scores = model.innovations(residuals, coordinate, weights, draws)
    np.testing.assert_allclose(scores[near], stats.norm.ppf(probability[near]), atol=1e-9)


def test_white_is_the_independent_normal():
    rng = np.random.default_rng(4)
    coordinate, weights = record(rng)
    sigma = np.array([0.3, 2.0])
    residuals = rng.normal(size=(2, coordinate.size))
    expected = stats.norm.logpdf(residuals, scale=sigma[:, None] * np.sqrt(weights))
    model = REGISTRY["white"]()
    draws = {"sigma_white": sigma}
    np.testing.assert_allclose(
        model.pointwise_log_prob(residuals, coordinate, weights, draws), expected, rtol=RELATIVE
    )


@pytest.mark.parametrize("name", REGISTRY)
class TestEveryModel:
    def test_sum_of_pointwise_is_log_prob(self, name):
        rng = np.random.default_rng(5)
        coordinate, weights = record(rng, 333)
        draws = make_draws(name, LANES + 5, rng)
        residuals = rng.normal(size=(LANES + 5, coordinate.size))
        model = REGISTRY[name]()
        np.testing.assert_allclose(
            model.log_prob(residuals, coordinate, weights, draws),
            model.pointwise_log_prob(residuals, coordinate, weights, draws).sum(axis=1),
            rtol=1e-12,
        )

    def test_a_draw_does_not_depend_on_its_neighbours(self, name):
        """Bit for bit, also next to draws that fail."""
        rng = np.random.default_rng(6)
        coordinate, weights = record(rng, 100)
        size = 2 * LANES + 3
        draws = make_draws(name, size, rng)
        residuals = rng.normal(size=(size, 100))
        residuals[1, 7], residuals[LANES, 0], residuals[5, 99] = np.nan, np.inf, -np.inf
        for values in draws.values():
            values[2] = np.nan
            values[3] *= -1.0
        model = REGISTRY[name]()
        together = model.log_prob(residuals, coordinate, weights, draws)
        for k in range(size):
            alone = {n: v[k : k + 1] for n, v in draws.items()}
            np.testing.assert_array_equal(
                model.log_prob(residuals[k : k + 1], coordinate, weights, alone), together[k]
            )
        failed = [1, 2, 3, 5, LANES]
        assert np.all(np.isneginf(together[failed]))
        assert np.all(np.isfinite(np.delete(together, failed)))

    def test_failed_rows_are_nan_and_silent(self, name):
        rng = np.random.default_rng(7)
        coordinate, weights = record(rng, 20)
        draws = make_draws(name, 3, rng)
        residuals = rng.normal(size=(3, 20))
        residuals[0, 19], residuals[1] = np.nan, np.nan
        model = REGISTRY[name]()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for method in (model.pointwise_log_prob, model.innovations):
                values = method(residuals, coordinate, weights, draws)
                assert np.all(np.isnan(values[:2]))
                assert np.all(np.isfinite(values[2]))
            log_prob = model.log_prob(residuals, coordinate, weights, draws)
        assert np.all(np.isneginf(log_prob[:2]))
        assert np.isnan(residuals[0]).sum() == 1, "the caller's residuals were changed"

    def test_default_priors(self, name):
        for p in REGISTRY[name]().parameters("V", 5.0, 200.0, "m"):
            assert p.symbol
            assert p.source
            if p.name.startswith("tau"):
                assert p.unit == "m"
                assert p.prior.from_normal(stats.norm.ppf(0.95)) == pytest.approx(20.0)
            elif p.name.startswith("sigma"):
                assert p.unit == "V"
                shares = {"sigma_white": 0.003, "sigma_offset": 0.001}
                median = 5.0 * shares.get(p.name, 0.01)
                assert p.prior.from_normal(0.0) == pytest.approx(median)

    def test_a_record_without_range_or_extent_is_refused(self, name):
        with pytest.raises(UserError, match="range of the response is 0"):
            REGISTRY[name]().parameters("V", 0.0, 200.0)
        usual = REGISTRY[name]().parameters("V", 1.0, 200.0)
        if any(p.name.startswith("tau") for p in usual):
            with pytest.raises(UserError, match="extent of the coordinate is 0"):
                REGISTRY[name]().parameters("V", 1.0, 0.0)

    def test_shapes_and_seeds(self, name):
        rng = np.random.default_rng(8)
        coordinate, weights = record(rng, 30)
        draws = make_draws(name, 4, rng)
        model = REGISTRY[name]()
        first = model.sample(np.random.default_rng(1), coordinate, weights, draws)
        second = model.sample(np.random.default_rng(1), coordinate, weights, draws)
        for a, b in zip(first, second, strict=True):
            assert a.shape == (4, 30)
            np.testing.assert_array_equal(a, b)
        for part in model.variances(draws, weights):
            assert part.shape == (4,)
            assert np.all(part >= 0.0)

    def test_variances_are_those_of_samples(self, name):
        rng = np.random.default_rng(11)
        coordinate, weights = record(rng, 40)
        usual = {"sigma_white": 1.0, "degrees_of_freedom": 10.0}
        names = [p.name for p in REGISTRY[name]().parameters("1", 1.0, 100.0)]
        draws = {n: np.full(20000, usual.get(n, 0.5)) for n in names}
        model = REGISTRY[name]()
        for sample, variance in zip(
            model.sample(rng, coordinate, weights, draws),
            model.variances(draws, weights),
            strict=True,
        ):
            assert np.mean(sample**2) == pytest.approx(variance[0], rel=0.03)


@pytest.mark.parametrize("scale", [1e-15, 1e12])
@pytest.mark.parametrize("name", GAUSSIAN)
def test_any_unit(name, scale):
    """Residuals and sigmas in other units: the density changes by N log(scale) only."""
    rng = np.random.default_rng(10)
    coordinate, weights = record(rng, 100)
    draws = make_draws(name, 3, rng)
    residuals = rng.normal(size=(3, 100))
    other = {n: v * scale if n.startswith("sigma") else v for n, v in draws.items()}
    model = REGISTRY[name]()
    np.testing.assert_allclose(
        model.log_prob(residuals * scale, coordinate, weights, other) + 100 * np.log(scale),
        model.log_prob(residuals, coordinate, weights, draws),
        rtol=1e-11,
    )


def test_extreme_ratio_of_the_two_parts():
    """No underflow where white noise is 1e-14 of the correlated variance, heavily averaged."""
    rng = np.random.default_rng(11)
    coordinate, weights = np.arange(64.0), np.full(64, 1e-4)
    draws = {
        "sigma_white": np.array([1e-7, 1.0]),
        "sigma_ou": np.array([1.0, 1e-9]),
        "tau_ou": np.array([1e20, 1e9]),
    }
    residuals = 1e-5 * rng.normal(size=(2, 64))
    model = REGISTRY["ornstein_uhlenbeck"]()
    np.testing.assert_allclose(
        model.log_prob(residuals, coordinate, weights, draws),
        model.pointwise_log_prob(residuals, coordinate, weights, draws).sum(axis=1),
        rtol=1e-9,
    )


def test_order_and_layout_of_the_arrays_do_not_matter():
    rng = np.random.default_rng(13)
    coordinate, weights = record(rng, 40)
    draws = make_draws("ornstein_uhlenbeck", 6, rng)
    residuals = rng.normal(size=(6, 40))
    model = REGISTRY["ornstein_uhlenbeck"]()
    expected = model.log_prob(residuals, coordinate, weights, draws)
    strided = {n: np.column_stack([v, v])[:, 0] for n, v in draws.items()}
    np.testing.assert_array_equal(
        model.log_prob(np.asfortranarray(residuals), coordinate, weights, strided), expected
    )


def test_only_independent_noise_is_marked_diagnostic():
    correlated = {"ornstein_uhlenbeck", "ornstein_uhlenbeck_offset", "ar1", "matern32"}
    marked = {n for n, m in REGISTRY.items() if m.diagnostic_only}
    assert marked >= {"white", "student_t"}
    assert not marked & correlated
    assert all(name == model.name for name, model in REGISTRY.items())


def test_a_zero_that_is_known_is_no_offset():
    """Also its limit: where it is as good as free, the level of a record tells nothing."""
    rng = np.random.default_rng(14)
    coordinate, weights = record(rng, 80)
    draws = make_draws("ornstein_uhlenbeck", 5, rng)
    residuals = rng.normal(size=(5, 80))
    usual = REGISTRY["ornstein_uhlenbeck"]().log_prob(residuals, coordinate, weights, draws)
    model = REGISTRY["ornstein_uhlenbeck_offset"]()

    def found(sigma, shift=0.0):
        offset = {"sigma_offset": np.full(5, sigma)}
        return model.log_prob(residuals + shift, coordinate, weights, draws | offset)

    np.testing.assert_allclose(found(0.0), usual, rtol=1e-12)
    np.testing.assert_allclose(found(1e6), found(1e6, shift=3.0), rtol=1e-6)


@pytest.mark.parametrize("far", [1.0, 1e3, 1e6])
def test_a_zero_far_off_costs_no_digits(far):
    """In units of the noise: the level, of which nothing is known, must not swamp what is."""
    rng = np.random.default_rng(15)
    coordinate, weights = record(rng, 80)
    draws = {
        "sigma_white": np.full(4, 0.5),
        "sigma_ou": np.full(4, 1.0),
        "tau_ou": np.full(4, 2.0),
        "sigma_offset": np.full(4, far),
    }
    residuals = rng.normal(size=(4, 80)) + far
    model = REGISTRY["ornstein_uhlenbeck_offset"]()
    np.testing.assert_allclose(
        model.log_prob(residuals, coordinate, weights, draws),
        model.pointwise_log_prob(residuals, coordinate, weights, draws).sum(axis=1),
        rtol=1e-8,
    )


def test_student_t_has_no_variance_where_its_tails_are_heavy():
    draws = {"sigma_white": np.ones(2), "degrees_of_freedom": np.array([1.5, 4.0])}
    _, white = REGISTRY["student_t"]().variances(draws, np.full(3, 0.5))
    assert white[0] == np.inf
    assert white[1] == pytest.approx(1.0)


@pytest.mark.parametrize("name", REGISTRY)
def test_every_correlation_length_is_declared(name):
    """Blocks of the leave-one-out score and the report's notice find it so."""
    model = REGISTRY[name]
    lengths = [p.name for p in model().parameters("1", 1.0, 100.0) if p.unit == "s"]
    assert lengths == ([model.length] if model.length else [])
