"""Power-scaling sensitivity against normal posteriors in closed form, and its weights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import logsumexp, ndtr

from deabayes.experiment import FloatArray
from deabayes.posteriors import sensitivity
from deabayes.posteriors.sensitivity import SENSITIVE, smoothed

DRAWS = 40_000


def sensitivities(log_component: FloatArray, quantities: dict[str, FloatArray]) -> dict[str, float]:
    """For independent draws."""
    sizes = {name: float(draws.size) for name, draws in quantities.items()}
    return sensitivity.sensitivities(log_component, quantities, sizes)


class Conjugate:
    """y ~ N(z, noise^2), z ~ N(0, 1): posterior of z under powers of prior and likelihood."""

    def __init__(self, y: float, noise: float) -> None:
        self.y, self.precision = y, noise**-2

    def posterior(self, prior_power: float = 1.0, likelihood_power: float = 1.0) -> FloatArray:
        """Mean and sd."""
        told = likelihood_power * self.precision
        return np.array([told * self.y, math.sqrt(prior_power + told)]) / (prior_power + told)

    def estimated(self, seed: int = 1) -> tuple[float, float, FloatArray]:
        """Prior and likelihood sensitivity of z from draws, and the draws."""
        mean, sd = self.posterior()
        z = mean + sd * np.random.default_rng(seed).standard_normal(DRAWS)
        components = -0.5 * z**2, -0.5 * self.precision * (self.y - z) ** 2
        prior, likelihood = (sensitivities(c, {"z": z})["z"] for c in components)
        return prior, likelihood, z

    def exact(self, z: FloatArray) -> tuple[float, float]:
        """The same from distribution functions, over the range of the draws z."""
        grid = np.linspace(z.min(), z.max(), 20_001)
        found = []
        for component in ("prior_power", "likelihood_power"):
            distances = [
                distance(grid, self.posterior(), self.posterior(**{component: alpha}))
                / abs(math.log2(alpha))
                for alpha in (0.99, 1.01)
            ]
            found.append(float(np.mean(distances)))
        return found[0], found[1]


def distance(grid: FloatArray, p: FloatArray, q: FloatArray) -> float:
    """Cumulative Jensen-Shannon distance of two normals (mean, sd), written out."""
    found = []
    for sign in (1.0, -1.0):
        cdf_p, cdf_q = (ndtr(sign * (grid - mean) / sd) for mean, sd in (p, q))
        middle = 0.5 * (cdf_p + cdf_q)
        terms = cdf_p * np.log2(cdf_p / middle) + cdf_q * np.log2(cdf_q / middle)
        found.append(np.trapezoid(terms, grid) / np.trapezoid(cdf_p + cdf_q, grid))
    return math.sqrt(max(found))


@pytest.mark.parametrize(
    ("y", "noise"), [(0.0, 1.0), (1.5, 1.0), (-4.0, 1.0), (3.0, 0.3), (8.0, 0.5), (0.0, 0.7)]
)
def test_conjugate_normal_moves_as_its_distribution_functions_do(y: float, noise: float) -> None:
    prior, likelihood, z = Conjugate(y, noise).estimated()
    exact_prior, exact_likelihood = Conjugate(y, noise).exact(z)
    assert prior == pytest.approx(exact_prior, rel=0.06, abs=0.005)
    assert likelihood == pytest.approx(exact_likelihood, rel=0.06, abs=0.005)


def test_an_uninformed_parameter_moves_with_the_prior_only() -> None:
    rng = np.random.default_rng(2)
    z = rng.standard_normal(DRAWS)
    told = 0.1 * rng.standard_normal(DRAWS)
    for flat in (np.full(DRAWS, -3.0), 1e3 + 1e-13 * z**2):
        assert sensitivities(flat, {"z": z})["z"] < 1e-4
    likelihood = sensitivities(-0.5 * (told / 0.1) ** 2, {"z": z, "told": told})
    assert likelihood["z"] < 0.01 < SENSITIVE < likelihood["told"]
    assert sensitivities(-0.5 * z**2, {"z": z})["z"] > SENSITIVE


def test_a_determined_parameter_moves_with_the_data_only() -> None:
    prior, likelihood, _ = Conjugate(0.8, 0.05).estimated()
    assert prior < SENSITIVE / 2
    assert likelihood > SENSITIVE


def test_prior_and_data_that_disagree_both_move() -> None:
    prior, likelihood, _ = Conjugate(8.0, 0.5).estimated()
    assert min(prior, likelihood) > 4 * SENSITIVE
    prior, likelihood, _ = Conjugate(0.0, 1.0).estimated()
    assert max(prior, likelihood) < SENSITIVE


def test_shift_unit_and_sign_of_a_quantity_do_not_matter() -> None:
    z = np.random.default_rng(3).standard_normal(4000)
    log_prior = -0.5 * (z - 1.0) ** 2
    found = sensitivities(log_prior, {"z": z, "other": 5.0 - 1e6 * z})
    assert found["z"] == pytest.approx(found["other"], rel=1e-6)


@pytest.mark.filterwarnings("error")
def test_sensitivity_is_unknown_for_unreliable_weights_or_draws() -> None:
    rng = np.random.default_rng(4)
    z = rng.standard_normal(4000)
    broken, held = np.where(np.arange(4000) == 7, np.nan, z), np.full(4000, 2.0)
    found = sensitivities(-0.5 * z**2, {"z": z, "broken": broken, "held": held})
    assert np.isfinite(found["z"]) and np.isnan(found["broken"]) and np.isnan(found["held"])
    assert np.isnan(sensitivities(np.zeros(4000), {"broken": broken})["broken"])
    heavy = 150.0 * rng.exponential(size=4000)  # k-hat 1.5 at alpha 1.01
    assert np.isnan(sensitivities(heavy, {"z": z})["z"])
    assert np.isnan(sensitivities(broken, {"z": z})["z"])
    assert np.isnan(sensitivities(-0.5 * z[:12] ** 2, {"z": z[:12]})["z"])


def test_few_effective_draws_show_only_large_sensitivities() -> None:
    """15 parameters that all have their prior; one of two more moves with it, by 1 sd."""
    z = np.random.default_rng(5).standard_normal((4000, 17))
    z[:, 16] += z[:, 15] ** 2
    log_prior = -0.5 * np.sum(z[:, :16] ** 2, axis=1)
    draws = {"still": np.random.default_rng(6).standard_normal(4000), "far": z[:, 16]}
    known = sensitivity.sensitivities(log_prior, draws, dict.fromkeys(draws, 4000.0))
    assert known["still"] < 0.03
    assert known["far"] > 2 * SENSITIVE
    few = sensitivity.sensitivities(log_prior, draws, dict.fromkeys(draws, 400.0))
    assert np.isnan(few["still"])
    assert few["far"] == known["far"]
    assert np.isnan(sensitivity.sensitivities(log_prior, draws, {"still": 4e3, "far": 9.0})["far"])


def test_an_insensitive_quantity_rarely_counts_as_moved() -> None:
    """Of 100 sets of 1000 draws a tenth at most are called moved, and some are known."""
    rng = np.random.default_rng(7)
    found = []
    for _ in range(100):
        log_prior = -0.5 * np.sum(rng.standard_normal((1000, 15)) ** 2, axis=1)
        found.append(sensitivities(log_prior, {"x": rng.standard_normal(1000)})["x"])
    assert np.mean(np.array(found) >= SENSITIVE) <= 0.1
    assert np.mean(np.isfinite(found)) > 0.9


def test_only_the_largest_weights_are_smoothed():
    log_weights = 0.3 * np.random.default_rng(1).normal(size=2000)
    found, k_hat = smoothed(log_weights)
    below = log_weights < np.quantile(log_weights, 0.8)
    change = found[below] - log_weights[below]
    np.testing.assert_allclose(change, change[0], atol=1e-12)
    assert logsumexp(found) == pytest.approx(0.0, abs=1e-12)
    assert k_hat < 0.5


@pytest.mark.parametrize("shape", [0.4, 0.9])
def test_the_shape_is_that_of_the_largest_weights(shape):
    """Weights u^(-k) of uniform u have a Pareto tail of the shape k; their inverses have none."""
    log_weights = -shape * np.log(np.random.default_rng(2).uniform(size=20000))
    found, k_hat = smoothed(log_weights)
    assert k_hat == pytest.approx(shape, abs=0.12)
    assert smoothed(-log_weights)[1] < 0.1
    assert np.exp(found).sum() == pytest.approx(1.0)


def test_even_weights_have_no_tail():
    found, k_hat = smoothed(np.full(50, -3.0) + 1e-9 * np.arange(50))
    np.testing.assert_allclose(np.exp(found), 0.02, rtol=1e-6)
    assert k_hat == 0.0


@pytest.mark.parametrize("log_weights", [np.array([0.0, 2.0, 5.0]), np.repeat([0.0, 1.0], 500)])
def test_where_no_tail_can_be_fitted_the_shape_is_infinite(log_weights):
    found, k_hat = smoothed(log_weights)
    assert k_hat == np.inf
    np.testing.assert_allclose(found, log_weights - logsumexp(log_weights))
