"""Sampling a posterior with independent ensembles of walkers, resumable after a kill.

All in z, where the prior is N(0, I). One run: tempered sequential Monte Carlo, a proposal
fitted and frozen, then emcee in chunks. Every stage has a random stream of its own
and is checkpointed, so that a killed run continues to the same draws, byte for byte.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deabayes.checkpoint import Arrays, Store
from deabayes.ensemble import Ensemble
from deabayes.faults import UserError
from deabayes.pooling import PooledResult, continue_ensemble, judge, pool
from deabayes.proposal import Proposal, fit
from deabayes.run import DROPPED_SHARE, Run, Target, stage_seed
from deabayes.smc import LogDensity, from_prior
from deabayes.study import Sampling

__all__ = ["Ensemble", "PooledResult", "continue_ensemble", "judge", "pool", "run_ensemble"]

WARM_UP, START, SAMPLING = range(3)
COMPONENTS, SETTLED_COMPONENTS = 4, 8
SETTLING_STEPS = 100
FIRST_PASS_SHARE = 0.4
"""Of the budget; the rest is for continuing with a proposal refitted to the other ensembles."""


def run_ensemble(
    log_likelihood: LogDensity,
    dimension: int,
    settings: Sampling,
    seed: np.random.SeedSequence,
    folder: Path | None = None,
    progress: bool = False,
) -> Ensemble:
    """Sample one ensemble until it is long enough by itself or its share of the budget is used.

    Parameters
    ----------
    log_likelihood : z (W, d) -> (W,); NaN or -inf where the model fails.
    folder : checkpoints, to be keyed by data, settings and code by the caller.

    Raises
    ------
    UserError : too few walkers, or no draw of the prior has a finite likelihood.
    """
    _check(dimension, settings)
    store, target = Store(folder), Target(log_likelihood)
    warm = store.once(
        "warm_up",
        lambda: target.counted(lambda: _warm_up(target, dimension, settings, seed, progress)),
    )
    start = store.once(
        "start", lambda: target.counted(lambda: _start(target, warm, settings, seed))
    )
    limit = settings.max_steps if settings.ensembles == 1 else FIRST_PASS_SHARE * settings.max_steps
    run = Run(
        target,
        Proposal.from_arrays(start),
        (start["walkers"], start["walkers_log_posterior"]),
        stage_seed(seed, SAMPLING),
        store.sub("chain"),
        settings,
    )
    run.advance(int(limit), stop_when_enough=True, progress=progress)
    return run.ensemble(
        dropped=DROPPED_SHARE,
        replaced_walkers=int(start["replaced"]),
        evaluations=warm["evaluations"] + start["evaluations"],
    )


def _check(dimension: int, settings: Sampling) -> None:
    if settings.walkers < 2 * dimension:
        raise UserError(
            f"sampling: {settings.walkers} walkers are too few for {dimension} parameters; "
            f"set walkers to at least {2 * dimension}"
        )


def _warm_up(
    target: Target,
    dimension: int,
    settings: Sampling,
    seed: np.random.SeedSequence,
    progress: bool,
) -> Arrays:
    from tqdm import tqdm

    particles = max(settings.particles, settings.walkers)
    with tqdm(total=100, desc="warm-up", unit="%", disable=not progress) as bar:

        def report(beta: float, rounds: int) -> None:
            bar.set_postfix_str(f"beta {beta:.2g}, {rounds} rounds", refresh=False)
            bar.update(int(100 * beta) - bar.n)

        rng = np.random.default_rng(stage_seed(seed, WARM_UP))
        population = from_prior(target.log_likelihood, dimension, particles, rng, report=report)
    return {
        "particles": population.particles,
        "broad": population.broad,
        "log_posterior": population.log_base + population.log_increment,
    }


def _start(
    target: Target, warm: Arrays, settings: Sampling, seed: np.random.SeedSequence
) -> Arrays:
    """Start half the walkers over-dispersed, replace those that are stuck, fit the proposal.

    The proposal fitted to the particles is used for settling only: the walkers' steps give
    more, and less biased, draws to fit the one that is frozen.
    """
    from deabayes.moves import build_sampler, initial_state

    rng = np.random.default_rng(stage_seed(seed, START, 0))
    proposal = fit(warm["particles"], COMPONENTS, rng, warm["log_posterior"])
    order = rng.permutation(len(warm["particles"]))
    walkers = warm["particles"][order[: settings.walkers]].copy()
    broad = settings.walkers // 2
    walkers[:broad] = warm["broad"][order[:broad]]
    lost = ~np.isfinite(target(walkers))
    walkers[lost] = warm["particles"][order[: settings.walkers]][lost]
    sampler = build_sampler(target, proposal, walkers.shape)
    state = initial_state(walkers, target(walkers), stage_seed(seed, START, 1))
    settled = sampler.run_mcmc(state, SETTLING_STEPS, store=False, skip_initial_state_check=True)
    low, middle = np.quantile(warm["log_posterior"], [0.01, 0.5])
    stuck = (settled.coords == walkers).all(axis=1) | (settled.log_prob < low - 3 * (middle - low))
    healthy = np.flatnonzero(warm["log_posterior"] >= low)
    settled.coords[stuck] = warm["particles"][rng.choice(healthy, stuck.sum(), replace=False)]
    settled.log_prob = target(settled.coords)
    last = sampler.run_mcmc(
        settled, 2 * SETTLING_STEPS // 5, thin_by=5, skip_initial_state_check=True
    )
    draws = sampler.get_chain(flat=True)
    proposal = fit(draws, SETTLED_COMPONENTS, rng, sampler.get_log_prob(flat=True))
    return {
        **proposal.arrays(),
        "walkers": last.coords,
        "walkers_log_posterior": last.log_prob,
        "replaced": np.asarray(stuck.sum()),
    }
