"""Ensembles sampled on side by side: the same draws, and nothing lost where a process fails."""

import os
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.statistical.test_sampling_stages import slow_run

from deabayes.sampling.checkpoint import Store
from deabayes.sampling.forked import run_apart
from deabayes.sampling.pooling import pool
from deabayes.sampling.proposal_fit import fit
from deabayes.sampling.run import Run, Target
from deabayes.study import Sampling

SETTINGS = Sampling(ensembles=3, walkers=32, max_steps=4000)


def likelihood(z):
    return -0.5 * ((z - 0.3) ** 2).sum(axis=1)


def runs():
    rng = np.random.default_rng(5)
    own = fit(rng.standard_normal((4000, 2)), 1, rng)
    return [slow_run(rng, 32, 400, 2, own) for _ in range(3)]


def pooled(folder, processes, log_likelihood=likelihood):
    seed = np.random.SeedSequence(6)
    return pool(log_likelihood, runs(), SETTINGS, seed, folder, processes=processes)


def test_draws_do_not_depend_on_the_number_of_processes(tmp_path):
    alone, three = pooled(tmp_path / "a", 1), pooled(tmp_path / "b", 3)
    assert alone.convergence.converged
    assert np.array_equal(alone.chain, three.chain)
    for one, other in zip(alone.ensembles, three.ensembles, strict=True):
        assert one.evaluations == other.evaluations
        assert one.steps == other.steps


def test_other_processes_do_the_sampling(tmp_path):
    parent, seen = os.getpid(), tmp_path / "seen"

    def watched(z):
        with seen.open("a") as file:
            file.write(f"{os.getpid()}\n")
        return likelihood(z)

    pooled(tmp_path / "c", 3, watched)
    found = [int(line) for line in seen.read_text().split()]
    assert len(set(found)) >= 3
    assert parent not in found


def test_an_error_of_another_process_is_met_again_here(tmp_path):
    def failing(z):
        raise ValueError("no likelihood today")

    with pytest.raises(ValueError, match="no likelihood today"):
        pooled(tmp_path / "d", 3, failing)


def test_no_more_processes_than_asked_for(tmp_path):
    def note(name):
        (tmp_path / f"{name}.start").write_text(str(time.monotonic()))
        time.sleep(0.2)
        (tmp_path / f"{name}.end").write_text(str(time.monotonic()))

    run_apart([lambda n=n: note(n) for n in range(5)], 2)
    starts, ends = (
        sorted(float(path.read_text()) for path in tmp_path.glob(f"*.{kind}"))
        for kind in ("start", "end")
    )
    assert len(ends) == 5
    assert all(start >= ends[index] for index, start in enumerate(starts[2:]))


def test_steps_beyond_a_round_do_not_count_in_it(tmp_path):
    """A run that was stopped further on is judged, and refitted or not, as at its first time."""
    first = runs()[0]
    start = first.chain[-1], first.log_posterior[-1]

    def ensemble(run, limit):
        run.advance(limit, may_stop=False, progress=False)
        return run.ensemble(0.1, 0, np.zeros(2, dtype=int), limit=limit)

    def run(settings):
        store = Store(tmp_path / str(settings.max_steps))
        return Run(
            Target(likelihood), first.proposal, start, np.random.SeedSequence(3), store, settings
        )

    for most in (3000, 9000):
        settings = replace(SETTINGS, max_steps=most)
        then = [ensemble(run(settings), limit) for limit in (700, 1500, 3000)]
        again = [ensemble(run(settings), limit) for limit in (700, 1500, 3000)]
        assert [each.steps for each in again] == pytest.approx([700, 1500, 3000], abs=3)
        for one, other in zip(then, again, strict=True):
            assert np.array_equal(one.chain, other.chain)
            assert one.evaluations == other.evaluations
