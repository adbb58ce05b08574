"""Convergence: the statistics agree with ArviZ, and every gate can fail."""

import numpy as np
import pytest

from deabayes.sampling import chains
from deabayes.sampling.diagnostics import GATE_STEPS, assess, mode_shares, summarise
from deabayes.study import Sampling

SETTINGS = Sampling(walkers=16)
SHAPE = (4, 300, 16)


def autoregression(correlation=0.5, shape=SHAPE, seed=0):
    """Stationary AR(1) of unit variance along the steps: tau = (1 + r) / (1 - r)."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(shape)
    for step in range(1, shape[1]):
        innovation = np.sqrt(1 - correlation**2) * values[:, step]
        values[:, step] = correlation * values[:, step - 1] + innovation
    return values


@pytest.mark.parametrize("correlation", [-0.3, 0.0, 0.5, 0.95])
def test_effective_sample_sizes_agree_with_arviz(correlation):
    from arviz_stats.base import array_stats

    values = autoregression(correlation)
    walkers = values.transpose(0, 2, 1).reshape(-1, SHAPE[1])
    assert chains.ess_bulk(values) == pytest.approx(array_stats.ess(walkers), rel=1e-6)
    assert chains.ess_mean(values) == pytest.approx(
        array_stats.ess(walkers, method="mean"), rel=1e-6
    )
    expected = array_stats.ess(walkers, method="tail", prob=(0.05, 0.95))
    assert chains.ess_tail(values) == pytest.approx(expected, rel=1e-3)


def test_r_hat_agrees_with_arviz_on_ensembles_as_chains():
    from arviz_stats.base import array_stats

    for values in (autoregression(), autoregression() + 0.2 * np.arange(4)[:, None, None]):
        expected = array_stats.rhat(values.reshape(4, -1))
        assert chains.r_hat(values) == pytest.approx(expected, rel=1e-9)


def test_tau_of_an_autoregression():
    assert chains.ess_mean(autoregression(0.8)) == pytest.approx(np.prod(SHAPE) / 9, rel=0.1)


def test_a_constant_is_converged_and_a_nan_is_not():
    table = summarise({"constant": np.full(SHAPE, 3.0), "failed": np.full(SHAPE, np.nan)})
    assert table.loc["constant", "r_hat"] == 1.0
    assert np.isnan(table.loc["failed", "ess_bulk"])


GOOD = {"mu": autoregression(seed=1), "tau": autoregression(0.3, seed=2)}


def judged(quantities, settings=SETTINGS, log_posterior=None):
    """As the engine judges: with draws and the log-posterior."""
    draws = np.stack(list(quantities.values()), axis=-1)
    if log_posterior is None:
        log_posterior = -0.5 * (draws**2).sum(-1)
    return assess(quantities, settings, log_posterior=log_posterior, draws=draws)


def test_good_runs_pass_every_gate():
    verdict = judged(GOOD)
    assert verdict.converged and verdict.reasons == []
    assert verdict.table.loc["mu", ["mean", "sd"]].to_numpy() == pytest.approx([0, 1], abs=0.05)
    assert verdict.autocorrelation_times == pytest.approx(np.full(4, 100), rel=0.2)
    assert len(verdict.mode_shares) == 1


def not_a_number():
    """Of one draw, between the steps that statistics are computed from."""
    values = autoregression(0.3, (4, 3000, 16), seed=5)
    between = np.setdiff1d(np.arange(3000), chains.thin_evenly(3000, GATE_STEPS))[0]
    values[2, between, 0] = np.inf
    return assess({"mu": values}, SETTINGS)


def one_run_elsewhere():
    values = autoregression()
    values[2] += 0.35
    return assess({"mu": values}, SETTINGS)


def one_run_wider():
    """With the same median: only the folded draws tell."""
    values = autoregression(0.0)
    values[2] *= 1.4
    return assess({"mu": values}, SETTINGS)


def slow_bulk():
    """Of so few walkers that runs long enough have not 400 draws' worth."""
    return assess({"mu": autoregression(0.8, (4, 300, 2), seed=3)}, SETTINGS)


def slow_tails():
    """Independent but for their size, which changes slowly."""
    size = np.exp(autoregression(0.95, (4, 400, 16), seed=7))
    signs = np.random.default_rng(7).choice([-1.0, 1.0], size.shape)
    values = signs * size * np.random.default_rng(8).uniform(0.9, 1.0, size.shape)
    return assess({"mu": values}, Sampling(ess=5000.0))


def short_runs():
    return assess({"mu": autoregression(0.96, (4, 300, 64), seed=1)}, SETTINGS)


def one_walker_frozen():
    log_posterior = -0.5 * (np.stack(list(GOOD.values())) ** 2).sum(axis=0)
    log_posterior[1, 100:, 3] = log_posterior[1, 100, 3]
    return judged(GOOD, log_posterior=log_posterior)


def one_walker_far_below():
    log_posterior = -0.5 * (np.stack(list(GOOD.values())) ** 2).sum(axis=0)
    log_posterior[0, :, 5] -= 50.0
    return judged(GOOD, log_posterior=log_posterior)


def two_runs_turned():
    """One distribution per coordinate, and another of both together."""
    a, b = np.moveaxis(np.random.default_rng(3).standard_normal((*SHAPE, 2)), -1, 0)
    turned = 0.6 * np.array([1, 1, -1, -1])[:, None, None] * a + 0.8 * b
    assert assess({"a": a, "b": turned}, SETTINGS).converged
    return judged({"a": a, "b": turned})


@pytest.mark.parametrize(
    ("case", "gate", "of", "text"),
    [
        (not_a_number, "finite", "mu", "some draws are not a number"),
        (one_run_elsewhere, "r_hat", "mu", "the independent runs disagree"),
        (one_run_wider, "r_hat", "mu", "the independent runs disagree"),
        (slow_bulk, "ess_bulk", "mu", "the bulk of the distribution has"),
        (slow_tails, "ess_tail", "mu", "the tail of the distribution has"),
        (short_runs, "length", "the runs", "autocorrelation times long, fewer than 10"),
        (one_walker_frozen, "stuck", "run 2", "1 of 16 walkers are stuck"),
        (one_walker_far_below, "stuck", "run 1", "1 of 16 walkers are stuck"),
        (two_runs_turned, "modes", "part", "weigh the modes differently"),
    ],
)
def test_each_gate_catches_what_no_other_does(case, gate, of, text):
    verdict = case()
    assert not verdict.converged
    assert {failure.gate for failure in verdict.failed} == {gate}
    assert any(failure.of.startswith(of) for failure in verdict.failed)
    assert all(text in reason for reason in verdict.reasons)
    assert all(("sample longer" in reason) == (gate not in ("finite", "stuck"))
               for reason in verdict.reasons)  # fmt: skip


def bimodal(shares, seed=0):
    rng = np.random.default_rng(seed)
    draws = 0.3 * rng.standard_normal((*SHAPE, 2))
    for run, share in enumerate(shares):
        draws[run, :, :, 0] += 5 * (rng.random(SHAPE[1:]) < share)
    return draws


def test_runs_must_have_equal_shares_of_two_modes():
    table, failed = mode_shares(bimodal([0.03, 0.03, 0.03, 0.03]))
    assert failed == [] and len(table) == 2
    assert table.loc[2].to_numpy() == pytest.approx(0.03, abs=0.01)
    _, failed = mode_shares(bimodal([0.03, 0.03, 0.0, 0.03]))
    assert any(f.of == "mode 2" and "0.0% of run 3" in f.text for f in failed)


def test_a_curved_ridge_is_one_mode():
    rng = np.random.default_rng(0)
    along = rng.standard_normal((*SHAPE, 1))
    ridge = np.concatenate([along, along**2 + 0.1 * rng.standard_normal(along.shape)], axis=-1)
    table, failed = mode_shares(ridge)
    assert len(table) == 1
    assert failed == []


def minority(shares, distance, dimension=14, seed=0):
    """A normal, and another so many of its sds away."""
    rng = np.random.default_rng(seed)
    draws = rng.standard_normal((*SHAPE, dimension))
    for run, share in enumerate(shares):
        draws[run, :, :, 0] += distance * (rng.random(SHAPE[1:]) < share)
    return draws


@pytest.mark.parametrize("missed", [(0,), (0, 1, 2)])
def test_a_small_mode_beside_a_large_one_is_missed_by_no_run(missed):
    """The two share draws, so that they count as one mode, of which every run has all."""
    shares = [0.0 if run in missed else 0.12 for run in range(4)]
    table, failed = mode_shares(minority(shares, 5.0))
    assert len(table) == 1 and failed
    assert all("part" in f.of and "weigh the modes differently" in f.text for f in failed)
    assert mode_shares(minority([0.12] * 4, 5.0))[1] == []


@pytest.mark.parametrize("seed", range(4))
def test_runs_that_agree_weigh_all_parts_alike(seed):
    """Correlated in time, and bent, so that it takes several components."""
    along = autoregression(0.9, (4, 2000, 16), seed)[..., None]
    rng = np.random.default_rng(seed)
    across = rng.standard_normal((*along.shape[:3], 5))
    bent = np.concatenate([along, 0.4 * along**2 + 0.2 * across[..., :1], across[..., 1:]], axis=-1)
    assert mode_shares(bent)[1] == []
