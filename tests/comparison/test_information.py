"""Expected information of experiments, against linear models whose answers are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from deabayes.comparison.further import candidate_information, parameter_information
from deabayes.noise import REGISTRY as NOISE
from deabayes.prediction.outcomes import Normal, Predictive, Reading

TIME = np.linspace(0.0, 1.0, 12)
CONSTANT, LINE = np.ones((1, 12)), np.stack([np.ones(12), TIME])
SIGMA = 0.3


def reading(curves, noise="white", scale=1.0, **noise_draws):
    values = {"sigma_white": SIGMA / scale} | noise_draws
    size = len(curves)
    draws = {name: np.full(size, value) for name, value in values.items()}
    scales, weights = np.full(size, scale), np.ones(TIME.size)
    return Reading(curves, scales, NOISE[noise](), draws, TIME, weights)


def predictive(curves, known=400, failed=(0, 1), **settings):
    whole = reading(curves, **settings)
    parts = (whole.of_draws(slice(0, known)),), (whole.of_draws(slice(known, None)),)
    return Predictive(*parts, failed)


def linear(design, mean, sd, seed, size=1400):
    """Curves mean + theta design with theta ~ N(0, sd^2)."""
    theta = sd * np.random.default_rng(seed).standard_normal((size, len(design)))
    return mean + theta @ design


def law(design, mean, sd):
    covariance = sd**2 * design.T @ design + SIGMA**2 * np.eye(TIME.size)
    return multivariate_normal(np.broadcast_to(mean, TIME.size), covariance)


def brute_force(laws, size=100_000):
    """I(M; y), and the probability of naming M rightly, from the densities themselves."""
    rng = np.random.default_rng(99)
    nats, right = [], []
    for truth, each in enumerate(laws):
        y = each.rvs(size, rng)
        log_p = np.stack([other.logpdf(y) for other in laws])
        nats.append(np.mean(log_p[truth] - np.logaddexp.reduce(log_p, axis=0)))
        right.append(np.mean(log_p.argmax(axis=0) == truth))
    return np.log(len(laws)) + np.mean(nats), np.mean(right)


@pytest.mark.parametrize(
    ("mean", "sd"), [(0.0, 0.5), (0.4, 0.5), (0.4, 0.1), (2.0, 5.0)]
)  # from hardly anything to much of what there is to know
def test_information_about_candidates_agrees_with_brute_force(mean, sd):
    models = [(CONSTANT, 0.0, sd), (LINE, mean, sd)]
    exact, right = brute_force([law(*model) for model in models])
    made = [predictive(linear(*model, seed)) for seed, model in enumerate(models)]
    found = candidate_information(made, np.random.default_rng(5))
    assert found.nats == pytest.approx(exact, abs=4 * found.nats_error)
    assert found.probability_right == pytest.approx(right, abs=4 * found.probability_right_error)
    assert found.nats_error < 0.015 and found.probability_right_error < 0.015


def test_three_candidates():
    models = [(CONSTANT, mean, 0.1) for mean in (-0.3, 0.0, 0.3)]
    exact, right = brute_force([law(*model) for model in models])
    made = [predictive(linear(*model, seed)) for seed, model in enumerate(models)]
    found = candidate_information(made, np.random.default_rng(6))
    assert found.nats == pytest.approx(exact, abs=4 * found.nats_error)
    assert found.probability_right == pytest.approx(right, abs=4 * found.probability_right_error)


def test_identical_candidates_tell_nothing():
    made = [predictive(linear(LINE, 0.0, 0.5, seed)) for seed in (1, 2)]
    found = candidate_information(made, np.random.default_rng(7))
    assert -0.05 < found.nats < 2.0 * found.nats_error
    assert found.probability_right == pytest.approx(0.5, abs=3 * found.probability_right_error)


@pytest.mark.parametrize("sd", [0.1, 0.5, 20.0])
def test_information_about_parameters_of_a_linear_model(sd):
    exact = 0.5 * np.linalg.slogdet(np.eye(2) + sd**2 / SIGMA**2 * LINE @ LINE.T)[1]
    found, error = parameter_information(predictive(linear(LINE, 0.0, sd, 3), known=1000))
    assert found == pytest.approx(exact, abs=0.08)
    assert error == pytest.approx(0.0, abs=1e-9)  # of one noise


def test_draws_without_a_response_tell_only_that_they_fail():
    curves = linear(LINE, 0.0, 0.5, 3)
    without_failures, _ = parameter_information(predictive(curves, known=1000))
    found, _ = parameter_information(predictive(curves, known=1000, failed=(95, 100)))
    failing = -(0.95 * np.log(0.95) + 0.05 * np.log(0.05))
    assert found == pytest.approx(0.05 * without_failures + failing)


@pytest.mark.parametrize("noise", ["ornstein_uhlenbeck", "matern32"])
def test_the_normal_predictive_is_the_dense_one(noise):
    """Correlated noise of a record and white noise of another, in other units, together."""
    rng = np.random.default_rng(4)
    correlated = {
        "ornstein_uhlenbeck": ("sigma_ou", "tau_ou"),
        "matern32": ("sigma_m32", "tau_m32"),
    }
    names = [p.name for p in NOISE[noise]().parameters("1", 1.0, 1.0)]
    assert correlated[noise][0] in names or len(names) == 3
    values = dict(zip(names, (SIGMA, 0.5, 0.2), strict=True))
    theta = rng.standard_normal((300, 2))
    one = reading(theta @ LINE, noise, **values)
    other = reading(1e3 * theta @ LINE[::-1], scale=1e3, sigma_white=SIGMA)
    residuals = np.eye(TIME.size)
    white, _ = one.whitened(residuals, 0)
    dense = np.linalg.inv(white @ white.T)
    noise_covariance = np.block([
        [dense, np.zeros((12, 12))], [np.zeros((12, 12)), 1e6 * SIGMA**2 * np.eye(12)]
    ])  # fmt: skip
    curves = np.concatenate([one.curves, other.curves], axis=1)
    exact = multivariate_normal(curves.mean(axis=0), noise_covariance + np.cov(curves.T))
    y = one.sample(rng)[:5], other.sample(rng)[:5]
    found = Normal.of((one, other), 0).log_density((one, other), y)
    np.testing.assert_allclose(found, exact.logpdf(np.concatenate(y, axis=1)), rtol=1e-6)
    # the noise's own law about one curve, from its samples
    alone = one.noise.sample(
        rng, TIME, np.ones(12), {n: np.full(20_000, v) for n, v in values.items()}
    )
    np.testing.assert_allclose(np.cov((alone[0] + alone[1]).T), dense, atol=0.02)


def test_a_failure_is_an_outcome_with_information():
    """Curves alike; one candidate's draws fail in half of the cases, the other's never do."""
    curves = [linear(LINE, 0.0, 0.5, seed) for seed in (1, 2)]
    never, half = (0, 1000), (500, 1000)
    made = [predictive(c, failed=f) for c, f in zip(curves, (half, never), strict=True)]
    found = candidate_information(made, np.random.default_rng(8))
    # p(fail) = 1/4; a failure names the first, a response has odds of 1 to 2
    exact = np.log(2) - 0.75 * (np.log(3) - 2 / 3 * np.log(2))
    assert found.nats == pytest.approx(exact, abs=0.02)
    assert found.probability_right == pytest.approx(0.75, abs=0.02)


def test_different_shares_of_failures_have_information():
    """Curves alike; a half and a quarter of the draws fail: a failure has odds of 2 to 1."""
    shares = (500, 1000), (250, 1000)
    curves = [linear(LINE, 0.0, 0.5, seed) for seed in (1, 2)]
    made = [predictive(c, failed=f) for c, f in zip(curves, shares, strict=True)]
    found = candidate_information(made, np.random.default_rng(8))
    joint = np.array([[0.5, 0.25], [0.5, 0.75]]) / 2
    odds = joint / joint.sum(axis=1, keepdims=True)
    assert found.nats == pytest.approx(np.sum(joint * np.log(2 * odds)), abs=0.01)
    assert found.probability_right == pytest.approx(joint.max(axis=1).sum(), abs=0.015)


def test_density_of_one_draw_is_its_noise_about_its_curve():
    """With residuals in proportion to something of each draw's own."""
    curves = linear(LINE, 0.0, 0.5, 1, size=3)
    scales = np.array([0.5, 1.0, 2.0])
    made = replace(reading(curves), scales=scales)
    exact = [
        multivariate_normal(curve, (scale * SIGMA) ** 2 * np.eye(12)).logpdf(TIME)
        for curve, scale in zip(curves, scales, strict=True)
    ]
    np.testing.assert_allclose(made.log_density(TIME), exact, rtol=1e-10)


def test_a_candidate_whose_draws_all_fail():
    lost = Predictive((), (), (1000, 1000))
    kept = predictive(linear(LINE, 0.0, 0.5, 1), failed=(0, 1000))
    found = candidate_information([kept, lost], np.random.default_rng(9))
    assert found.probability_right == 1.0
    assert found.nats == pytest.approx(np.log(2), abs=0.01)
    both = candidate_information([lost, lost], np.random.default_rng(9))
    assert both.nats == pytest.approx(0.0, abs=1e-9) and both.probability_right == 0.5


def test_student_t_noise_is_whitened_like_normal_noise():
    heavy = reading(linear(LINE, 0.0, 0.5, 1), "student_t", degrees_of_freedom=1e6)
    normal = reading(linear(LINE, 0.0, 0.5, 1))
    for one, other in zip(heavy.whitened(LINE, 0), normal.whitened(LINE, 0), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4)
