"""The walkers' start: settled from the warm-up's particles, and a proposal fitted and frozen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.chains import ess_bulk
from deabayes.sampling.checkpoint import Arrays
from deabayes.sampling.proposal import Proposal, fit
from deabayes.sampling.run import Target, stage_seed
from deabayes.study import Sampling

COMPONENTS, SETTLED_COMPONENTS = 4, 8
SETTLING_STEPS = 200
SETTLING_SHARE, LEAST_SETTLING = 0.15, 1000
"""Of the budget, at most, and not counted in it; and steps that are always allowed."""
SETTLED_TIMES = 8.0
"""Autocorrelation times in the last round."""
LEVEL_STILL, STILL, CHANCE = 0.2, 0.1, 2.0
"""By how much two rounds may change the mean log-posterior and means of coordinates, in standard
deviations, and the logarithms of spreads: the last two, and so many standard errors more."""
STORED_PER_ROUND = 40
WALKERS, STUCK, ROUNDS = range(3)
"""Random streams: of rounds, the first and those after it."""


def settled_start(
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

    rng = np.random.default_rng(stage_seed(seed, WALKERS))
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
        sampler = build_sampler(target, proposal, walkers.shape, target.guide.hop)
        state = initial_state(walkers, log_posterior, stage_seed(seed, ROUNDS + len(rounds)))
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
    """What a round of settling tells: where walkers are, autocorrelation times, whether to go on.

    Attributes
    ----------
    level : mean log-posterior; `mean`, `spread` and `effective` (d,) of every coordinate, the
        last its effective sample size.
    times : autocorrelation times of the slowest coordinate.
    steady : all are what they were two rounds ago. The log-posterior rises where walkers start
        on the rim of the bulk and falls where they start at a peak; the spread grows where they
        start on a part of a ridge and creep along it at the same log-posterior.
    """

    level: float
    mean: FloatArray
    spread: FloatArray
    effective: FloatArray
    times: float
    steady: bool

    @classmethod
    def of(cls, chain: FloatArray, log_posterior: FloatArray, before: Sequence[Round]) -> Round:
        """Of its draws, chain (S, W, d) and log_posterior (S W,)."""
        level, width = float(log_posterior.mean()), float(log_posterior.std())
        coordinates = np.moveaxis(chain, 2, 0)[:, None]
        effective = np.array([ess_bulk(values) for values in coordinates])
        now = cls(
            level,
            chain.mean(axis=(0, 1)),
            chain.std(axis=(0, 1)),
            effective,
            float(effective.min() / chain.shape[1]),
            steady=False,
        )
        steady = len(before) >= 2 and abs(level - before[-2].level) < LEVEL_STILL * width
        return replace(now, steady=steady and now.stands_where(before[-2]))

    def stands_where(self, before: Round) -> bool:
        """Whether means and spreads of all coordinates are the same but for chance."""
        chance = CHANCE * np.sqrt(1.0 / self.effective + 1.0 / before.effective)
        moved = np.abs(self.mean - before.mean) / self.spread
        grown = np.abs(np.log(self.spread / before.spread))
        return bool(np.all(np.maximum(moved, grown) < STILL + chance))

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
    sampler = build_sampler(target, proposal, walkers.shape, target.guide.hop)
    state = initial_state(walkers, target(walkers), stage_seed(seed, STUCK))
    settled = sampler.run_mcmc(state, SETTLING_STEPS, store=False, skip_initial_state_check=True)
    low, middle = np.quantile(warm["log_posterior"], [0.01, 0.5])
    stuck = (settled.coords == walkers).all(axis=1) | (settled.log_prob < low - 3 * (middle - low))
    healthy = np.flatnonzero(warm["log_posterior"] >= low)
    settled.coords[stuck] = warm["particles"][rng.choice(healthy, stuck.sum(), replace=False)]
    return settled.coords, int(stuck.sum())
