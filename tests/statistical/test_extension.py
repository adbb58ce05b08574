"""Runs that agree and are nearly long enough go on as they are; nothing of them is lost."""

from dataclasses import replace

import numpy as np
import pytest
from tests.statistical.test_sampling_stages import slow_run

from deabayes.sampling.pooling import pool
from deabayes.sampling.proposal_fit import fit
from deabayes.study import Sampling

SETTINGS = Sampling(ensembles=3, walkers=32, max_steps=4000)


def likelihood(z):
    return np.zeros(len(z))


def runs(times, lengths=(400, 400, 800)):
    """Of N(0, I), each `times` autocorrelation times long after 100 steps that are dropped."""
    rng = np.random.default_rng(5)
    own = fit(rng.standard_normal((4000, 2)), 1, rng)
    found = [slow_run(rng, 32, steps, times, own) for steps in lengths]
    return [replace(run, steps=run.steps + 100, burn_in=100) for run in found]


def pooled(before, folder=None, processes=1):
    seed = np.random.SeedSequence(6)
    return pool(likelihood, before, SETTINGS, seed, folder, processes=processes)


def test_draws_before_and_after_are_kept():
    before = runs(40)
    found = pooled(before)
    assert found.convergence.converged, found.convergence.reasons
    for first, run in zip(before, found.ensembles, strict=True):
        assert not run.refitted
        assert run.proposal is first.proposal
        dropped = run.burn_in - first.burn_in
        assert 0 <= dropped < 0.1 * run.steps
        overlap = len(first.chain) - dropped
        np.testing.assert_array_equal(run.chain[:overlap], first.chain[dropped:])
        assert len(run.chain) == run.steps - run.burn_in
    grown = [
        (run.steps - 100) / (first.steps - 100)
        for first, run in zip(before, found.ensembles, strict=True)
    ]
    assert 1.3 <= min(grown) == pytest.approx(max(grown), rel=0.01)


def test_what_comes_after_goes_on_from_the_last_step():
    (first, *_), (run, *_) = runs(40), pooled(runs(40)).ensembles
    after = run.chain[len(first.chain) - (run.burn_in - first.burn_in) :]
    assert np.abs(after.mean()) < 0.05
    assert after.std() == pytest.approx(1.0, abs=0.05)
    z = after.reshape(-1, 2)
    expected = -0.5 * (z**2).sum(axis=1) - np.log(2.0 * np.pi)
    np.testing.assert_allclose(run.log_posterior[-len(after) :].ravel(), expected)


def refitted_at_once(found):
    """Whether what is dropped is all of the first 500 steps, and a tenth of what came after."""
    ends = [500 + 0.1 * (run.steps - 500) for run in found.ensembles[:2]]
    return [run.burn_in for run in found.ensembles[:2]] == pytest.approx(ends, abs=2)


@pytest.mark.parametrize("times", [5, 15])
def test_runs_that_are_far_too_short_are_not_gone_on_with(times):
    assert refitted_at_once(pooled(runs(times)))


def test_runs_that_disagree_are_not_gone_on_with():
    first, *others = runs(40)
    apart = replace(first, chain=first.chain + 3.0)
    assert refitted_at_once(pooled([apart, *others]))


def test_a_larger_budget_than_they_were_made_with_is_no_mistake():
    """10 steps from one that is stored to the next: those before are 1 apart."""
    settings = replace(SETTINGS, max_steps=40000)
    found = pool(likelihood, runs(40), settings, np.random.SeedSequence(6))
    assert found.convergence.converged
    assert refitted_at_once(found)


def test_what_was_made_is_not_made_again(tmp_path):
    whole = pooled(runs(40), tmp_path / "a")
    again, three = pooled(runs(40), tmp_path / "a"), pooled(runs(40), tmp_path / "b", 3)
    for other in (again, three):
        np.testing.assert_array_equal(whole.chain, other.chain)
        for one, same in zip(whole.ensembles, other.ensembles, strict=True):
            assert one.evaluations == same.evaluations


def test_the_numbers_of_two_that_are_one():
    rng = np.random.default_rng(7)
    own = fit(rng.standard_normal((4000, 2)), 1, rng)
    first, later = slow_run(rng, 8, 300, 30, own), slow_run(rng, 8, 600, 60, own)
    first = replace(first, thin=2, steps=700, burn_in=100, acceptance=0.2)
    later = replace(later, thin=2, steps=1900, burn_in=700, acceptance=0.5, evaluations=900)
    found = first.followed_by(later)
    assert (found.steps, found.burn_in, found.evaluations) == (1900, 190, 900)
    assert found.chain.shape == (855, 8, 2)
    np.testing.assert_array_equal(found.chain[0], first.chain[45])
    np.testing.assert_array_equal(found.log_posterior[-1], later.log_posterior[-1])
    assert found.acceptance == pytest.approx((510 * 0.2 + 1200 * 0.5) / 1710)
    assert found.autocorrelation_time == pytest.approx(20.0, rel=0.25)
