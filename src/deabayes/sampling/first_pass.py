"""The first pass: one ensemble of walkers from the prior on, resumable after a kill.

All in z, where the prior is N(0, I). One run: tempered sequential Monte Carlo, a proposal
fitted and frozen, then emcee in chunks. Every stage has a random stream of its own
and is checkpointed, so that a killed run continues to the same draws, byte for byte.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.sampling.carrying import carried, higher_peak
from deabayes.sampling.chains import ess_bulk
from deabayes.sampling.checkpoint import Arrays, Store
from deabayes.sampling.climb import bulk_missed, draws_of_peaks, find_peaks
from deabayes.sampling.cloud import LogDensity, Schedule
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.guide import NO_GUIDE, Guide
from deabayes.sampling.progress import progress_bar
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.proposal_fit import fit
from deabayes.sampling.run import DROPPED_SHARE, Run, Target, stage_seed
from deabayes.sampling.smc import Population, from_prior, settle
from deabayes.study import Sampling

WARM_UP, START, SAMPLING = range(3)
COMPONENTS, SETTLED_COMPONENTS = 4, 8
SETTLING_STEPS = 200
WARM_UP_SCHEDULE = Schedule(final_forgotten=0.3, final_rounds=(4, 60))
"""What the warm-up leaves undone at beta = 1, settling does."""
SETTLING_SHARE, LEAST_SETTLING = 0.15, 1000
"""Of the budget, at most, and not counted in it; and steps that are always allowed."""
SETTLED_TIMES = 8.0
"""Autocorrelation times in the last round."""
STORED_PER_ROUND = 40
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
        "start", lambda: dropped.counted(lambda: _start(dropped, warm, settings, seed))
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
    run.advance(int(limit), may_stop=True, progress=progress)
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
    peaks, places = find_peaks(target, population, rng), target.guide.elsewhere
    best = max(peaks, key=lambda peak: peak.log_density)
    if places is not None and (higher := higher_peak(target, best, population.factor, places)):
        population = carried(target, population, higher, rng, WARM_UP_SCHEDULE, target.guide)
    elif bulk_missed(population.log_density, best.log_density, best.z.size):
        draws = draws_of_peaks(target, peaks, len(population.particles), rng)
        population = settle(draws, target, rng, WARM_UP_SCHEDULE, target.guide)
    return {
        "particles": population.particles,
        "broad": population.broad,
        "log_posterior": population.log_density,
    }


def _start(
    target: Target, warm: Arrays, settings: Sampling, seed: np.random.SeedSequence
) -> Arrays:
    """Start half the walkers over-dispersed, let them settle, fit the proposal that is frozen.

    The particles may be far from where the posterior's mass is, or on a part of it only (a
    record with little noise makes it a thin curved sheet that few moves of the warm-up
    follow), so walkers settle in rounds until the log-posterior stands still and a round holds
    several autocorrelation times. Each has a proposal refitted to the rounds before, which are
    nearer, and to the particles, which are more nearly independent: to few effective draws a
    proposal is fitted badly, however many there are.
    Rounds grow where it stands still but a round is too short. All their draws are dropped.
    """
    from deabayes.sampling.moves import build_sampler, initial_state

    rng = np.random.default_rng(stage_seed(seed, START, 0))
    walkers, replaced = _first_walkers(target, warm, settings, seed, rng)
    proposal = _of_particles(target, warm, rng)
    log_posterior = target(walkers)
    particles = warm["particles"], warm["log_posterior"]
    draws: list[tuple[FloatArray, FloatArray]] = []
    rounds: list[Round] = []
    steps, spent = SETTLING_STEPS, 0
    allowed = max(SETTLING_SHARE * settings.max_steps, LEAST_SETTLING)
    while spent < allowed and not (rounds and rounds[-1].settled):
        thin = steps // STORED_PER_ROUND
        sampler = build_sampler(target, proposal, walkers.shape, target.guide)
        state = initial_state(walkers, log_posterior, stage_seed(seed, START, 2 + len(rounds)))
        state = sampler.run_mcmc(
            state, STORED_PER_ROUND, thin_by=thin, skip_initial_state_check=True
        )
        walkers, log_posterior = state.coords, state.log_prob
        draws = [*draws[-2:], (sampler.get_chain(flat=True), sampler.get_log_prob(flat=True))]
        z, densities = (np.concatenate(parts) for parts in zip(particles, *draws, strict=True))
        proposal = fit(z, SETTLED_COMPONENTS, rng, densities, coordinates=target.guide.coordinates)
        rounds.append(Round.of(sampler.get_chain(), draws[-1][1], rounds))
        spent += steps
        if rounds[-1].steady:
            steps = steps * 3 // 2
    return {
        **proposal.arrays(),
        "walkers": walkers,
        "replaced": np.asarray(replaced),
    }


def _of_particles(target: Target, warm: Arrays, rng: np.random.Generator) -> Proposal:
    particles, densities = warm["particles"], warm["log_posterior"]
    return fit(particles, COMPONENTS, rng, densities, coordinates=target.guide.coordinates)


@dataclass(frozen=True)
class Round:
    """What a round of settling tells: log-posterior, autocorrelation times, whether to go on.

    Attributes
    ----------
    steady : the mean log-posterior is where it was two rounds ago. It rises where walkers
        start on the rim of the bulk and falls where they start at a peak.
    """

    mean: float
    times: float
    steady: bool

    @classmethod
    def of(cls, chain: FloatArray, log_posterior: FloatArray, before: Sequence[Round]) -> Round:
        """Of its draws, chain (S, W, d) and log_posterior (S W,)."""
        mean, spread = float(log_posterior.mean()), float(log_posterior.std())
        coordinates = np.moveaxis(chain, 2, 0)[:, None]
        times = min(ess_bulk(values) for values in coordinates) / chain.shape[1]
        steady = len(before) >= 2 and abs(mean - before[-2].mean) < 0.2 * spread
        return cls(mean, float(times), steady)

    @property
    def settled(self) -> bool:
        return self.steady and self.times >= SETTLED_TIMES


def _first_walkers(
    target: Target,
    warm: Arrays,
    settings: Sampling,
    seed: np.random.SeedSequence,
    rng: np.random.Generator,
) -> tuple[FloatArray, int]:
    """Walkers (W, d) from the particles, half of them over-dispersed.

    Those that are stuck after a few steps are replaced, and counted.
    """
    from deabayes.sampling.moves import build_sampler, initial_state

    order = rng.permutation(len(warm["particles"]))
    walkers = warm["particles"][order[: settings.walkers]].copy()
    broad = settings.walkers // 2
    walkers[:broad] = warm["broad"][order[:broad]]
    lost = ~np.isfinite(target(walkers))
    walkers[lost] = warm["particles"][order[: settings.walkers]][lost]
    proposal = _of_particles(target, warm, rng)
    sampler = build_sampler(target, proposal, walkers.shape, target.guide)
    state = initial_state(walkers, target(walkers), stage_seed(seed, START, 1))
    settled = sampler.run_mcmc(state, SETTLING_STEPS, store=False, skip_initial_state_check=True)
    low, middle = np.quantile(warm["log_posterior"], [0.01, 0.5])
    stuck = (settled.coords == walkers).all(axis=1) | (settled.log_prob < low - 3 * (middle - low))
    healthy = np.flatnonzero(warm["log_posterior"] >= low)
    settled.coords[stuck] = warm["particles"][rng.choice(healthy, stuck.sum(), replace=False)]
    return settled.coords, int(stuck.sum())
