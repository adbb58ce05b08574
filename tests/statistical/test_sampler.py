"""Posteriors known in closed form or by quadrature, and runs whose outcome is known."""

from dataclasses import replace

import numpy as np
import pytest

from deabayes.comparison.left_out import ON_THE_WAY
from deabayes.sampling.diagnostics import assess
from deabayes.sampling.first_pass import run_ensemble
from deabayes.sampling.pooling import pool
from deabayes.sampling.smc import anneal, from_prior, log_standard_normal
from deabayes.study import Sampling


def sample(log_likelihood, dimension, seed=1, **changes):
    settings = Sampling(**({"walkers": 64, "max_steps": 10000} | changes))
    ensembles = [
        run_ensemble(log_likelihood, dimension, settings, np.random.SeedSequence([seed, index]))
        for index in range(settings.ensembles)
    ]
    return pool(log_likelihood, ensembles, settings, np.random.SeedSequence([seed, 99]))


def test_conjugate_linear_gaussian_posterior():
    """y = A z + noise with prior N(0, I): means within 4 MCSE, sd within 3 %."""
    rng = np.random.default_rng(5)
    design = rng.standard_normal((12, 6)) @ np.diag(np.geomspace(0.3, 30, 6))
    data = design @ rng.standard_normal(6) + 0.5 * rng.standard_normal(12)
    covariance = np.linalg.inv(design.T @ design / 0.25 + np.eye(6))
    mean = covariance @ design.T @ data / 0.25

    result = sample(lambda z: -0.5 * ((data - z @ design.T) ** 2).sum(1) / 0.25, 6)

    table = result.convergence.table
    assert result.convergence.converged, result.convergence.reasons
    assert np.all(np.abs(table["mean"] - mean) < 4 * table["mcse_mean"])
    assert table["sd"].to_numpy() == pytest.approx(np.sqrt(np.diag(covariance)), rel=0.03)


def two_modes(z):
    """Likelihood for which the posterior has 10 % of its mass in a second, far mode."""
    first = -0.5 * ((z + 1) ** 2).sum(1) / 0.1**2
    second = -0.5 * ((z - 1) ** 2).sum(1) / 0.1**2
    return np.logaddexp(np.log(0.9) + first, np.log(0.1) + second) - log_standard_normal(z)


def test_two_modes_get_their_shares():
    result = sample(two_modes, 4)
    assert result.convergence.converged, result.convergence.reasons
    assert (result.chain[..., 0] > 0).mean() == pytest.approx(0.1, abs=0.01)
    assert len(result.convergence.mode_shares) == 2


def ridge(z):
    """A likelihood that ties z_2 to the square of z_1 within a thirtieth of the prior's width."""
    return -0.5 * ((z[:, 1] - 0.6 * (z[:, 0] ** 2 - 1)) / 0.03) ** 2


def ridge_moments():
    """Means and sds of the ridge by quadrature."""
    first, second = np.meshgrid(np.linspace(-6, 6, 3001), np.linspace(-1.5, 6, 3001))
    z = np.column_stack([first.ravel(), second.ravel()])
    weights = np.exp(ridge(z) + log_standard_normal(z))
    weights /= weights.sum()
    mean = weights @ z
    return mean, np.sqrt(weights @ (z - mean) ** 2)


def test_a_narrow_curved_ridge():
    result = sample(ridge, 2)
    table, (mean, sd) = result.convergence.table, ridge_moments()
    assert result.convergence.converged, result.convergence.reasons
    assert np.all(np.abs(table["mean"] - mean) < 4 * table["mcse_mean"])
    assert table["sd"].to_numpy() == pytest.approx(sd, rel=0.03)


def failing_half(z):
    """NaN for z_1 < 0: half the prior fails."""
    return np.where(z[:, 0] < 0, np.nan, -0.5 * ((z - 0.5) ** 2).sum(1) / 0.01)


def test_failures_are_counted_and_never_kept():
    settings = Sampling(walkers=32, max_steps=1500)
    ensemble = run_ensemble(failing_half, 3, settings, np.random.SeedSequence(1))
    assert ensemble.evaluations > 32 * 600
    assert 0.001 < ensemble.failed_share < 0.5
    assert ensemble.chain[..., 0].min() > 0
    assert np.isfinite(ensemble.log_posterior).all()


def test_same_seed_same_draws_and_another_seed_others():
    settings = Sampling(walkers=32, max_steps=1500)
    first, again, other = (
        run_ensemble(two_modes, 2, settings, np.random.SeedSequence(seed)).chain
        for seed in (1, 1, 2)
    )
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_a_budget_too_small_is_said():
    result = sample(ridge, 2, max_steps=100)
    assert not result.convergence.converged
    assert all(ensemble.steps <= 100 for ensemble in result.ensembles)
    assert any("sample longer" in reason for reason in result.convergence.reasons)


def test_no_refit_throws_away_what_the_budget_cannot_replace():
    """16 000 steps: 2120 alone, hopelessly, and the rest in one piece with a refitted proposal."""
    never = {"autocorrelation_times": 1e6, "max_steps": 16000, "ensembles": 2}
    result = sample(lambda z: -0.5 * (z**2).sum(1), 2, **never)
    for ensemble in result.ensembles:
        assert ensemble.steps == 16000
        assert ensemble.steps - ensemble.burn_in == pytest.approx(0.9 * (16000 - 2120), abs=10)


def test_one_shifted_ensemble_fails_the_gates():
    result = sample(lambda z: -0.5 * (z**2).sum(1), 2, max_steps=4000)
    chain = result.chain.copy()
    chain[0] += 0.5
    assert not assess({"mu": chain[..., 0], "tau": chain[..., 1]}, Sampling()).converged


def test_evidence_and_annealing_out_of_a_record():
    """Gaussian records: log p(y1, y2), and log p(y2 | y1) by taking y2 out again."""

    def log_normal(z, data, sd):
        return -0.5 * ((z - data) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi))

    def first(z):
        return log_normal(z, 0.5, 0.3).sum(1)

    def second(z):
        return log_normal(z, 0.9, 0.4).sum(1)

    def joint(z):
        return first(z) + second(z) + log_standard_normal(z)

    def out(schedule=None):
        rng = np.random.default_rng(2)
        return anneal(both.particles, joint, lambda z: -second(z), rng, schedule)

    both = from_prior(lambda z: first(z) + second(z), 3, 2048, np.random.default_rng(1))
    without = out()
    variance = 1 / (1 + 1 / 0.09)
    predictive = log_normal(0.9, variance * 0.5 / 0.09, np.sqrt(variance + 0.16))
    alone = log_normal(0.5, 0.0, np.sqrt(1.09))
    assert both.log_evidence == pytest.approx(3 * (alone + predictive), abs=0.25)
    assert -without.log_evidence == pytest.approx(3 * predictive, abs=0.15)
    assert out(replace(ON_THE_WAY, crossed=False)).log_evidence == without.log_evidence
    assert without.particles.mean() == pytest.approx(variance * 0.5 / 0.09, abs=0.03)
    assert without.particles.std() == pytest.approx(np.sqrt(variance), rel=0.05)
