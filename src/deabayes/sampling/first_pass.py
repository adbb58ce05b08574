"""The first pass: one ensemble of walkers from the prior on, resumable after a kill.

All in z, where the prior is N(0, I). One run: tempered sequential Monte Carlo, a proposal
fitted and frozen, then emcee in chunks. Every stage has a random stream of its own
and is checkpointed, so that a killed run continues to the same draws, byte for byte.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deabayes.faults import UserError
from deabayes.sampling.checkpoint import Arrays, Store
from deabayes.sampling.climb import bulk_missed, draws_of_peaks, find_peaks
from deabayes.sampling.cloud import LogDensity, Schedule
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.guide import NO_GUIDE, Guide
from deabayes.sampling.progress import progress_bar
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.run import DROPPED_SHARE, Run, Target, stage_seed
from deabayes.sampling.smc import Population, from_prior, settle
from deabayes.sampling.start import settled_start
from deabayes.study import Sampling

WARM_UP, START, SAMPLING = range(3)
WARM_UP_SCHEDULE = Schedule(final_forgotten=0.3, final_rounds=(4, 60))
"""What the warm-up leaves undone at beta = 1, settling does."""
FIRST_PASS_SHARE = 0.25
"""Of the budget; the rest is for continuing with a proposal refitted to all of them."""


def run_ensemble(
    log_likelihood: LogDensity,
    dimension: int,
    settings: Sampling,
    seed: np.random.SeedSequence,
    folder: Path | None = None,
    progress: bool = False,
    guide: Guide = NO_GUIDE,
    rough: LogDensity | None = None,
) -> Ensemble:
    """Sample one ensemble until it is long enough by itself or its share of the budget is used.

    Parameters
    ----------
    log_likelihood : z (W, d) -> (W,); NaN or -inf where the model fails.
    folder : checkpoints, to be keyed by data, settings and code by the caller.
    guide : what is known of the posterior before.
    rough : a cheaper log_likelihood, nearly the same, for the draws that are dropped.

    Raises
    ------
    UserError : too few walkers, or no draw of the prior has a finite likelihood.
    """
    _check(dimension, settings)
    store, target = Store(folder), Target(log_likelihood, guide)
    dropped = Target(rough or log_likelihood, guide)
    warm = store.once(
        "warm_up",
        lambda: dropped.counted(lambda: _warm_up(dropped, dimension, settings, seed, progress)),
    )
    start = store.once(
        "start",
        lambda: dropped.counted(
            lambda: settled_start(dropped, warm, settings, stage_seed(seed, START))
        ),
    )
    limit = settings.max_steps if settings.ensembles == 1 else FIRST_PASS_SHARE * settings.max_steps
    run = Run(
        target,
        Proposal.from_arrays(start, guide.coordinates),
        (start["walkers"], target(start["walkers"])),
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
    particles = max(settings.particles, settings.walkers)
    with progress_bar(progress, total=100, desc="warm-up", unit="%") as bar:

        def report(beta: float, rounds: int) -> None:
            bar.set_postfix_str(f"beta {beta:.2g}, {rounds} rounds", refresh=False)
            bar.update(int(100 * beta) - bar.n)

        rng = np.random.default_rng(stage_seed(seed, WARM_UP))
        population = from_prior(
            target.log_likelihood, dimension, particles, rng, WARM_UP_SCHEDULE, report, target.guide
        )
    return _onto_the_bulk(target, population, rng)


def _onto_the_bulk(target: Target, population: Population, rng: np.random.Generator) -> Arrays:
    """The particles (P, d), or, where they missed the posterior's bulk, others that are on it."""
    log_posterior = population.log_base + population.log_increment
    peaks = find_peaks(target, population, rng)
    best = max(peak.log_density for peak in peaks)
    particles, broad = population.particles, population.broad
    if bulk_missed(log_posterior, best, particles.shape[1]):
        broad = draws_of_peaks(target, peaks, len(particles), rng)
        moved = settle(broad, target, rng, WARM_UP_SCHEDULE, target.guide)
        particles, log_posterior = moved.particles, moved.log_base
    return {"particles": particles, "broad": broad, "log_posterior": log_posterior}
