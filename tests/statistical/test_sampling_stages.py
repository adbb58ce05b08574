"""What happens before sampling proper, and when proposals are refitted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deabayes.sampling import pooling
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.first_pass import run_ensemble
from deabayes.sampling.mixture import Mixture
from deabayes.sampling.pooling import pool
from deabayes.sampling.proposal import Part, Proposal
from deabayes.sampling.proposal_fit import fit
from deabayes.sampling.refit import better_proposals, divergence, leave_out, worst_covered
from deabayes.sampling.smc import log_standard_normal
from deabayes.study import Sampling

SETTINGS = Sampling(ensembles=2, walkers=32, particles=256, max_steps=4000)


def shifted(z):
    return -0.5 * np.sum((z - 0.5) ** 2, axis=1) / 0.3**2


def test_a_rough_likelihood_serves_what_is_dropped_only():
    seen = []

    def rough(z):
        seen.append(len(z))
        return shifted(z) + 5.0 + 0.01 * z[:, 0]

    found = run_ensemble(shifted, 2, SETTINGS, np.random.SeedSequence(1), rough=rough)
    z = found.chain.reshape(-1, 2)
    expected = shifted(z) + log_standard_normal(z)
    assert found.log_posterior.ravel() == pytest.approx(expected)
    assert 1000 < sum(seen) < found.evaluations
    assert z.mean() == pytest.approx(0.5 / 1.09, abs=0.02)


def slow_run(rng, walkers, steps, times, own):
    """A stationary run of a unit Gaussian, `times` autocorrelation times long, and its proposal."""
    keep = np.exp(-2.0 * times / steps)
    chain = rng.standard_normal((steps, walkers, own.dimension))
    for now in range(1, steps):
        chain[now] = keep * chain[now - 1] + np.sqrt(1 - keep**2) * chain[now]
    flat = chain.reshape(-1, own.dimension)
    return Ensemble(
        chain, log_standard_normal(flat).reshape(steps, walkers), own, steps=steps, burn_in=0,
        thin=1, acceptance=0.3, autocorrelation_time=steps / times, replaced_walkers=0,
        evaluations=0, failures=0, enough=False,
    )  # fmt: skip


def test_a_proposal_is_refitted_where_that_is_better():
    """Two poor runs' draws better no proposal; a long one's better the poor proposal only."""
    rng = np.random.default_rng(3)
    fair = fit(1.1 * rng.standard_normal((4000, 6)), 1, rng)
    poor = fit(0.5 * rng.standard_normal((4000, 6)) + 0.3, 1, rng)
    long, short = slow_run(rng, 32, 400, 100, fair), slow_run(rng, 32, 400, 2, fair)
    assert better_proposals([short], rng, Coordinates()) == [fair]
    runs = [long, replace(short, proposal=poor)]
    kept, again = better_proposals(runs, rng, Coordinates())
    assert kept is fair
    z = rng.standard_normal((2000, 6))
    assert again.log_density(z).mean() > fair.log_density(z).mean() - 0.1
    settings = Sampling(ensembles=2, walkers=32, max_steps=500)
    pooled = pool(lambda z: np.zeros(len(z)), runs, settings, np.random.SeedSequence(4))
    assert [run.refitted for run in pooled.ensembles] == [False, True]
    assert pooled.ensembles[0].proposal is fair


def test_the_divergence_of_normal_densities():
    """p = N(0, 1), q = N(0, s^2): the mean of (p/q)^(1/2) is (s / (3/2 - 1/(2 s^2)))^(1/2)."""
    s, z = 0.8, np.random.default_rng(8).standard_normal((200000, 1))
    narrow = Mixture(np.ones(1), np.zeros((1, 1)), np.full((1, 1, 1), s), 1e9)
    expected = 0.5 * np.log(s / (1.5 - 0.5 / s**2))
    found = divergence(Proposal((Part(1.0, narrow),)), z, log_standard_normal(z))
    assert found == pytest.approx(expected, abs=0.002)


def test_a_proposal_leaves_out_what_other_runs_found():
    """One of a hundred draws lies twelve standard deviations out, where the target is flat."""
    rng = np.random.default_rng(7)
    own = fit(rng.standard_normal((4000, 2)), 1, rng)
    run = slow_run(rng, 32, 400, 400, own)
    assert not leave_out([run], rng)
    chain, log_posterior = run.chain.copy(), run.log_posterior.copy()
    far = rng.random(log_posterior.shape) < 0.01
    chain[far, 0] += 12.0
    run = replace(run, chain=chain, log_posterior=log_posterior)
    assert leave_out([run], rng)
    found = better_proposals([run], rng, Coordinates())[0]
    assert not leave_out([replace(run, proposal=found)], rng)


@pytest.mark.parametrize("caught", [0, 3])
def test_a_place_that_one_walker_found_is_proposed_by_the_refit(caught):
    """It sits twelve sds out for a quarter of a run; others, and what they leave out, are alike."""
    rng = np.random.default_rng(11)
    own = fit(rng.standard_normal((20000, 2)), 1, rng)
    runs = [slow_run(rng, 32, 800, 400, own) for _ in range(2)]
    chain, log_posterior = runs[1].chain.copy(), runs[1].log_posterior.copy()
    chain[600:, caught] = [12.0, 0.0] + 0.01 * rng.standard_normal((200, 2))
    log_posterior[600:, caught] = -3.0
    runs[1] = replace(runs[1], chain=chain, log_posterior=log_posterior)
    assert worst_covered(runs) == caught
    found = better_proposals(runs, rng, Coordinates())
    far = np.array([[12.0, 0.0]])
    assert all(each.log_density(far)[0] > own.log_density(far)[0] + 5.0 for each in found)


def test_a_refit_is_fitted_to_runs_before_earlier_refits_too():
    """A hundredth of an earlier run lies twelve sds out, where the run at hand has not been."""
    rng = np.random.default_rng(12)
    poor = fit(0.5 * rng.standard_normal((4000, 2)) + 0.3, 1, rng)
    run, before = (slow_run(rng, 32, 400, 100, poor) for _ in range(2))
    chain, log_posterior = before.chain.copy(), before.log_posterior.copy()
    chain[rng.random(log_posterior.shape) < 0.01, 0] += 12.0
    before = replace(before, chain=chain, log_posterior=log_posterior)
    far = np.array([[12.0, 0.0]])
    (alone,) = better_proposals([run], rng, Coordinates())
    (both,) = better_proposals([run], rng, Coordinates(), [before])
    assert poor not in (alone, both)
    assert both.log_density(far)[0] > alone.log_density(far)[0] + 5.0


def test_nothing_is_thrown_away_where_no_proposal_gets_better(monkeypatch):
    """400 steps are gone on from, 90 % of the other 7600 kept, however often a refit is tried."""
    tried = []

    def their_own(ensembles, rng, coordinates, earlier):
        tried.append(len(ensembles))
        return [each.proposal for each in ensembles]

    monkeypatch.setattr("deabayes.sampling.pooling.better_proposals", their_own)
    rng = np.random.default_rng(5)
    fair = fit(rng.standard_normal((4000, 2)), 1, rng)
    runs = [slow_run(rng, 32, 400, 2, fair) for _ in range(2)]
    settings = Sampling(ensembles=2, walkers=32, max_steps=8000, autocorrelation_times=1e6)
    pooled = pool(lambda z: np.zeros(len(z)), runs, settings, np.random.SeedSequence(6))
    assert len(tried) > 2
    assert not any(run.refitted for run in pooled.ensembles)
    assert [run.steps for run in pooled.ensembles] == [8000, 8000]
    assert pooled.ensembles[0].burn_in == pytest.approx(400 + 0.1 * 7600, abs=10)


def test_runs_after_a_refit_are_as_long_as_refits_were_not_as_tries(monkeypatch):
    """Two tries better nothing; the next one does and is followed by 2000 steps, not by 8000."""
    rng = np.random.default_rng(9)
    fair, other = (fit(rng.standard_normal((4000, 2)), 1, rng) for _ in range(2))
    tried, asked = [], []

    def at_the_fourth_try(ensembles, rng, coordinates, earlier):
        tried.append(len(ensembles))
        return [other if len(tried) >= 4 else each.proposal for each in ensembles]

    class Seen(Exception):
        pass

    def lengths(runs, ensembles, total, *more):
        asked.append(total)
        if len(asked) == 4:
            raise Seen
        return continue_all(runs, ensembles, total, *more)

    continue_all = pooling._continue_all
    monkeypatch.setattr(pooling, "better_proposals", at_the_fourth_try)
    monkeypatch.setattr(pooling, "_continue_all", lengths)
    monkeypatch.setattr(pooling, "leave_out", lambda ensembles, rng: True)
    runs = [slow_run(rng, 32, 400, 2, fair) for _ in range(2)]
    settings = Sampling(ensembles=2, walkers=32, max_steps=40000, autocorrelation_times=1e6)
    with pytest.raises(Seen):
        pooling.pool(lambda z: np.zeros(len(z)), runs, settings, np.random.SeedSequence(6))
    assert asked[0] == 1000
    assert asked[:3] == sorted(asked[:3])
    assert asked[3] == 2000


@pytest.mark.parametrize(("times", "refits"), [((100, 2, 100), 4), ((2, 2, 100), 3)])
def test_a_late_refit_pays_where_one_run_is_held_up(times, refits, monkeypatch):
    """Of 12 000 steps, 4000 after the third refit, 4600 are left: enough for two of three runs."""
    rng = np.random.default_rng(10)
    made, before = [], []

    def another(ensembles, rng, coordinates, earlier):
        before.append(len(earlier))
        made.append(fit(rng.standard_normal((400, 2)), 1, rng))
        return [made[-1] for _ in ensembles]

    def verdict(ensembles, settings, quantities=None):
        return SimpleNamespace(converged=False, agree=False, autocorrelation_times=np.array(times))

    monkeypatch.setattr(pooling, "better_proposals", another)
    monkeypatch.setattr(pooling, "judge", verdict)
    monkeypatch.setattr(pooling, "leave_out", lambda ensembles, rng: True)
    own = fit(rng.standard_normal((4000, 2)), 1, rng)
    runs = [slow_run(rng, 32, 400, number, own) for number in times]
    settings = Sampling(ensembles=3, walkers=32, max_steps=12000)
    pooling.pool(lambda z: np.zeros(len(z)), runs, settings, np.random.SeedSequence(6))
    assert len(made) == refits
    assert before == [3 * number for number in range(refits)]
