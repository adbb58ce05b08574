"""A run that grows in chunks: one chain, and when it stops by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.statistical.proposals import wide_proposal

from deabayes.sampling.checkpoint import Store
from deabayes.sampling.guide import NO_GUIDE
from deabayes.sampling.mixture import Mixture
from deabayes.sampling.moves import build_sampler, initial_state
from deabayes.sampling.proposal import Part, Proposal
from deabayes.sampling.run import Run, Target
from deabayes.sampling.smc import log_standard_normal
from deabayes.study import Sampling


def test_chunks_are_one_chain():
    """Sampling in chunks gives what emcee gives in one go: the random stream goes on."""
    walkers = np.random.default_rng(0).standard_normal((32, 3))
    start, seed = (walkers, log_standard_normal(walkers)), np.random.SeedSequence(4)
    settings = Sampling(walkers=32, max_steps=8000)
    target = Target(lambda z: np.zeros(len(z)))
    run = Run(target, wide_proposal(3), start, seed, Store(None), settings)
    run.advance(600, may_stop=False, progress=False)
    sampler = build_sampler(log_standard_normal, wide_proposal(3), (32, 3))
    sampler.run_mcmc(initial_state(*start, seed), 300, thin_by=2)
    chunks = run.store.chunks()
    assert len(chunks) > 2
    chain = np.concatenate([chunk["chain"] for chunk in chunks])
    assert chain.tobytes() == sampler.get_chain().tobytes()


def test_only_a_cheap_target_is_asked_for_several_proposals_of_each_walker_at_once():
    asked = []

    def target(z):
        asked.append(len(z))
        return log_standard_normal(z)

    walkers = np.random.default_rng(0).standard_normal((32, 3))
    for several, largest in ((True, 5 * 32), (False, 32)):
        proposal, guide = replace(wide_proposal(3), tries=5), replace(NO_GUIDE, several=several)
        sampler = build_sampler(target, proposal, (32, 3), guide)
        asked.clear()
        sampler.run_mcmc(initial_state(walkers, target(walkers), np.random.SeedSequence(4)), 50)
        assert max(asked) == largest


@pytest.mark.parametrize(
    ("wanted", "least", "most"), [(5, 1000, 3000), (60, 4000, 4000), (2000, 2000, 2400)]
)
def test_a_run_stops_when_it_is_long_enough_or_never_will_be(wanted, least, most):
    """Hardly a proposal is accepted: 60 times are more than 4000 steps, but not 8000."""
    walkers = np.random.default_rng(0).standard_normal((32, 10))
    start, seed = (walkers, log_standard_normal(walkers)), np.random.SeedSequence(4)
    settings = Sampling(walkers=32, max_steps=16000, autocorrelation_times=wanted)
    target = Target(lambda z: np.zeros(len(z)))
    far_too_wide = Mixture(np.ones(1), np.zeros((1, 10)), 4.0 * np.eye(10)[None])
    run = Run(target, Proposal((Part(1.0, far_too_wide),)), start, seed, Store(None), settings)
    run.advance(4000, may_stop=True, progress=False)
    last = run.store.chunks()[-1]
    assert least <= run.stored * run.thin <= most
    assert (bool(last["enough"]), bool(last["hopeless"])) == (wanted == 5, wanted == 2000)
