"""Convergence: the statistics agree with ArviZ, and every gate can fail."""

import numpy as np
import pytest

from deabayes.sampling import chains
from deabayes.sampling.diagnostics import GATE_STEPS, assess, mode_shares, stuck_walkers, summarise
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


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_every_draw_must_be_a_number(value):
    """Those too between the steps that are looked at."""
    long = autoregression(0.3, (4, 3000, 16), seed=5)
    values = long.copy()
    values[:, np.setdiff1d(np.arange(3000), chains.thin_evenly(3000, GATE_STEPS)), 0] = value
    found = [str(each) for each in assess({"mu": values, "tau": long}, SETTINGS).failed]
    assert len([text for text in found if "some draws are not a number" in text]) == 1


def test_good_runs_pass_every_gate():
    quantities = {"mu": autoregression(seed=1), "tau": autoregression(0.3, seed=2)}
    draws = np.stack(list(quantities.values()), axis=-1)
    verdict = assess(
        quantities,
        SETTINGS,
        dropped=np.full(4, 0.25),
        log_posterior=-0.5 * (draws**2).sum(-1),
        draws=draws,
    )
    assert verdict.converged, verdict.reasons
    columns = " ".join(verdict.table.columns)
    assert columns == "mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat"
    assert verdict.table.loc["mu", "sd"] == pytest.approx(1, abs=0.05)
    assert verdict.autocorrelation_times == pytest.approx(100, rel=0.2)


def failing(change):
    values = autoregression(seed=1)
    change(values)
    return assess({"mu": values}, SETTINGS, dropped=np.full(4, 0.25), log_posterior=-(values**2))


def test_a_shifted_run_fails_in_plain_words():
    def shift(values):
        values[2] += 0.5

    verdict = failing(shift)
    assert not verdict.converged
    assert any("mu: R-hat" in reason and "disagree" in reason for reason in verdict.reasons)


def test_a_stuck_walker_fails():
    def freeze(values):
        values[1, :, 3] = values[1, 0, 3]

    verdict = failing(freeze)
    assert any("run 2: 1 of 16 walkers are stuck" in reason for reason in verdict.reasons)


def test_a_walker_far_below_is_stuck_although_it_moves():
    log_posterior = -(autoregression() ** 2)
    log_posterior[0, :, 5] -= 50
    assert np.argwhere(stuck_walkers(log_posterior)).tolist() == [[0, 5]]


def test_short_runs_fail():
    verdict = assess(
        {"mu": autoregression(0.9)}, SETTINGS, dropped=np.full(4, 0.01), log_posterior=None
    )
    text = " ".join(verdict.reasons)
    assert "autocorrelation times long, fewer than 50" in text
    assert "were dropped at its start, fewer than 5" in text


def test_few_effective_draws_fail():
    verdict = assess({"mu": autoregression()}, Sampling(ess=1e6))
    assert any("the tail of the distribution rests on" in reason for reason in verdict.reasons)


def test_a_drifting_autocorrelation_time_fails():
    values = autoregression(0.5)
    values[:, 240:] = values[:, 239:240] + 0.01 * values[:, 240:]
    verdict = assess({"mu": values}, SETTINGS)
    assert any("autocorrelation time still changes" in reason for reason in verdict.reasons)


def bimodal(shares, seed=0):
    rng = np.random.default_rng(seed)
    draws = 0.3 * rng.standard_normal((*SHAPE, 2))
    for run, share in enumerate(shares):
        draws[run, :, :, 0] += 5 * (rng.random(SHAPE[1:]) < share)
    return draws


def test_equal_shares_of_two_modes_pass():
    table, failed = mode_shares(bimodal([0.03, 0.03, 0.03, 0.03]))
    assert failed == []
    assert len(table) == 2
    assert table.loc[2].to_numpy() == pytest.approx(0.03, abs=0.01)


def test_a_mode_that_one_run_missed_fails():
    _, failed = mode_shares(bimodal([0.03, 0.03, 0.0, 0.03]))
    assert any(each.of == "mode 2" and "0.0% of run 3" in each.text for each in failed)


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
    assert all("part" in each.of and "weigh the modes differently" in each.text for each in failed)
    assert mode_shares(minority([0.12] * 4, 5.0))[1] == []


@pytest.mark.parametrize("correlation", [0.6, 0.98])
def test_runs_with_one_distribution_per_coordinate_and_another_of_both_fail(correlation):
    draws = np.random.default_rng(3).standard_normal((*SHAPE, 2))
    for run, sign in enumerate((1, 1, -1, -1)):
        rest = np.sqrt(1.0 - correlation**2) * draws[run, ..., 1]
        draws[run, ..., 1] = sign * correlation * draws[run, ..., 0] + rest
    quantities = {"a": draws[..., 0], "b": draws[..., 1]}
    assert assess(quantities, SETTINGS).converged
    verdict = assess(quantities, SETTINGS, draws=draws)
    assert not verdict.converged and {each.gate for each in verdict.failed} == {"modes"}


@pytest.mark.parametrize("seed", range(8))
def test_runs_that_agree_weigh_all_parts_alike(seed):
    """Correlated in time, and bent, so that it takes several components."""
    along = autoregression(0.9, (4, 2000, 16), seed)[..., None]
    rng = np.random.default_rng(seed)
    across = rng.standard_normal((*along.shape[:3], 5))
    bent = np.concatenate([along, 0.4 * along**2 + 0.2 * across[..., :1], across[..., 1:]], axis=-1)
    assert mode_shares(bent)[1] == []


def drifting(steps, late=4.0):
    """Runs whose last fifth holds a walker that sits still: tau rises in the last fifth."""
    values = autoregression(0.5, (4, steps, 16), seed=4)
    values[:, int(0.82 * steps) : int(0.86 * steps), 0] = late
    return {"mu": values}


def tau_reasons(quantities, **settings):
    found = assess(quantities, Sampling(walkers=16, **settings))
    return [reason for reason in found.reasons if "autocorrelation time still" in reason], found


def test_a_tau_that_changes_is_said():
    """By 10 % in runs of 92 tau: too much where 70 were asked for, not where 50 were."""
    asked = {
        wanted: tau_reasons(drifting(300, late=2.0), autocorrelation_times=wanted)
        for wanted in (70.0, 50.0)
    }
    assert asked[50.0][1].autocorrelation_times.min() == pytest.approx(92.0, abs=1.0)
    assert "10%" in asked[70.0][0][0] and "more than 5%" in asked[70.0][0][0]
    assert asked[50.0][0] == []


@pytest.mark.parametrize("steps", [400, 450, 501, 900])
def test_independent_draws_have_one_tau_however_many(steps):
    """Thinned to 400 at most: all of 450 steps by two, their first 360 not at all."""
    draws = np.random.default_rng(steps).standard_normal((4, steps, 16))
    assert tau_reasons({"mu": draws})[0] == []


def test_however_long_the_runs_a_tau_must_not_change_by_more():
    (reason,), _ = tau_reasons(drifting(300, late=8.0), autocorrelation_times=1.0)
    assert "16%" in reason and "more than 15%" in reason
