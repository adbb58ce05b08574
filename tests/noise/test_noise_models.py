"""What every noise model keeps: rows apart, failures silent, priors, shapes and variances."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.shared.noise_records import make_draws, record

from deabayes.faults import UserError
from deabayes.noise import REGISTRY
from deabayes.noise.base import noise_coordinates
from deabayes.noise.kalman import LANES
from deabayes.prior.joint import Prior


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

    def test_two_amplitudes_have_coordinates_of_total_and_ratio(self, name):
        """A model of one amplitude has none; ar1 once named those of the model it is made of."""
        model = REGISTRY[name]()
        usual = model.parameters("V", 5.0, 200.0)
        prior = Prior([replace(p, name=f"step.{p.name}") for p in usual])
        columns = frozenset(range(len(usual)))
        pairs = noise_coordinates(model, prior, {"step": (1.0, 1.0)}, columns)
        assert len(pairs) == sum(p.name.startswith("sigma") for p in usual[:2]) - 1

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


@pytest.mark.parametrize("name", REGISTRY)
def test_every_correlation_length_is_declared(name):
    """Blocks of the leave-one-out score and the report's notice find it so."""
    model = REGISTRY[name]
    lengths = [p.name for p in model().parameters("1", 1.0, 100.0) if p.unit == "s"]
    assert lengths == ([model.length] if model.length else [])
