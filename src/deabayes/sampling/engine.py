"""Sample one candidate from its prior to its posterior: a state machine over all ensembles.

warm-up -> fitted -> sampling -> judged -> (longer: sampling | refitted: fitted) -> ... -> done.

Each state is a function that reads and writes checkpoints and returns the next state. A state
depends only on the seed, the settings and the stored checkpoints. A killed run therefore resumes
and ends with identical bytes. Proposals are not stored: they are fitted again.

Each round of sampling uses one frozen proposal. The next round replaces the draws of the round
before. Proposals are fitted to the draws of all ensembles. Given the proposal, the ensembles are
independent.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from emcee import EnsembleSampler
from emcee.state import State as Walkers

from deabayes.experiment import FloatArray
from deabayes.sampling import chains
from deabayes.sampling.checkpoint import Arrays, Store, random_state_arrays, random_state_from
from deabayes.sampling.diagnostics import Convergence, assess, stuck_walkers
from deabayes.sampling.moves import recipe
from deabayes.sampling.problem import EveryDrawFailed, Problem, Target
from deabayes.sampling.progress import Progress
from deabayes.sampling.proposal import Proposal, fit
from deabayes.sampling.tempering import Populations
from deabayes.sampling.warm_up import warm_up
from deabayes.study import Sampling

WARM_UP, FIT, SAMPLING, RESTART = range(4)
"""Numbers of the random streams."""
FIRST_ROUND, GROWTH = 300, 1.5
"""Goal of the first round [steps], and the factor by which every refit raises the goal."""
DROPPED = 1 / 3
"""Share of a round that is dropped as burn-in.

If the kept part covers 10 autocorrelation times, the dropped part covers 5. The influence of the
starting points has then decayed to e^-5."""
PATIENCE = 2.5
"""Continue a round if it needs at most this multiple of its steps; otherwise refit the proposal."""
MOST_REFITS = 6
AIM, AFFORDABLE = 4000.0, 400_000
"""A run that passes its gates continues to this effective sample size or this many evaluations.

At this size, the 5 and 95 % quantiles of two seeds agree within 0.15 standard deviations."""
MARGIN, LEAST_GROWTH = 1.05, 1.25
"""Safety factor on the expected steps, and least growth of a round before the next judgement."""
COMPONENTS = 8
"""Components of the mixtures in a proposal; the part that covers missed regions has half."""
CHUNK = 100
"""Stored steps between two checkpoints."""
MOST_STORED_STEPS = 5000
PARTICLES_UNTIL = 2
"""Last refit that also uses the warm-up's particles, which are nearly independent."""
GATE_STEPS = 250
"""Most steps per walker from which a running sampler is judged."""


@dataclass(frozen=True)
class Sampled:
    """The draws of a candidate in z, and the verdict on their convergence.

    Attributes
    ----------
    chain : (E, S, W, d), in time order; `log_posterior` (E, S, W).
    convergence : the verdict.
    steps : all steps of each ensemble after the warm-up. The first `burn_in` are dropped. Of the
        others, every `thin`-th step is kept.
    rounds : number of sampling rounds, each with its own proposal.
    acceptance : share of proposals accepted in the last round.
    evaluations, failures : likelihood evaluations, and how many gave no finite value.
    """

    chain: FloatArray
    log_posterior: FloatArray
    convergence: Convergence
    steps: int
    burn_in: int
    thin: int
    rounds: int
    acceptance: float
    evaluations: int
    failures: int

    def thinned(self, most: int) -> tuple[FloatArray, FloatArray]:
        """Return z (E, S, d) and log-posterior (E, S), at most `most` draws per ensemble.

        The draws are spread evenly over time and randomly over the walkers. If there are about as
        many steps as picks, evenly spaced picks would come from a few walkers only.
        """
        _, steps, walkers, _ = self.chain.shape
        picked = np.linspace(0, steps * walkers - 1, min(most, steps * walkers), dtype=np.intp)
        step = picked // walkers
        shifts = np.random.default_rng(0).integers(walkers, size=(steps,))
        walker = (picked + shifts[step]) % walkers
        return self.chain[:, step, walker], self.log_posterior[:, step, walker]


def sample(
    problem: Problem,
    settings: Sampling,
    seed: np.random.SeedSequence,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> Sampled:
    """Sample a posterior until every gate passes or the budget ends; the verdict says which.

    Parameters
    ----------
    folder : folder for checkpoints; None stores none. The caller must use another folder for
        other data, settings or code.

    Raises
    ------
    EveryDrawFailed : no draw of the prior has a finite likelihood.
    """
    settings = replace(settings, walkers=max(settings.walkers, 2 * problem.dimension))
    run = _Run(problem, settings, seed, Store(folder), progress or Progress())
    state: State | None = _warm_up
    while state is not None:
        state = state(run)
    run.progress.end()
    return run.result()


@dataclass
class _Run:
    """Data shared by the states; all of it follows from seed, settings and checkpoints."""

    problem: Problem
    settings: Sampling
    seed: np.random.SeedSequence
    store: Store
    progress: Progress
    warm: Arrays = field(default_factory=dict)
    refits: int = 0
    steps_before: int = 0
    goal: int = 0
    needed: float = 0.0
    proposal: Proposal | None = None
    round: Store = field(default_factory=lambda: Store(None))
    last: Arrays | None = None
    earlier: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    convergence: Convergence | None = None
    counts: FloatArray = field(default_factory=lambda: np.zeros(2))
    seconds: float = 0.0

    @property
    def chunks(self) -> list[Arrays]:
        """Chunks of this round."""
        return self.round.chunks()

    @property
    def thin(self) -> int:
        return -(-self.settings.max_steps // MOST_STORED_STEPS)

    @property
    def steps(self) -> int:
        """Steps of this round."""
        return self.thin * sum(len(chunk["chain"]) for chunk in self.chunks)

    @property
    def left(self) -> int:
        """Steps left in the budget, a multiple of `thin`."""
        return (self.settings.max_steps - self.steps_before - self.steps) // self.thin * self.thin

    def stream(self, *stage: int) -> np.random.SeedSequence:
        """Return the random stream of a stage; it depends only on the seed and the stage."""
        return np.random.SeedSequence(self.seed.entropy, spawn_key=(*self.seed.spawn_key, *stage))

    def draws(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Return the last `share` of this round: z (E, S, W, d) and log-posterior (E, S, W)."""
        shape = self.settings.ensembles, self.settings.walkers
        chain = np.concatenate([chunk["chain"] for chunk in self.chunks])
        log_posterior = np.concatenate([chunk["log_posterior"] for chunk in self.chunks])
        first = len(chain) - int(share * len(chain))
        chain, log_posterior = chain[first:], log_posterior[first:]
        return (
            np.moveaxis(chain.reshape(len(chain), *shape, -1), 0, 1),
            np.moveaxis(log_posterior.reshape(len(chain), *shape), 0, 1),
        )

    def result(self) -> Sampled:
        chain, log_posterior = self.draws(1.0 - DROPPED)
        assert self.convergence is not None
        stored = sum(len(chunk["chain"]) for chunk in self.chunks)
        total = self.steps_before + self.steps
        return Sampled(
            chain,
            log_posterior,
            self.convergence,
            steps=total,
            burn_in=total - chain.shape[1] * self.thin,
            thin=self.thin,
            rounds=self.refits + 1,
            acceptance=float(sum(chunk["accepted"] for chunk in self.chunks) / stored),
            evaluations=int(self.counts[0]),
            failures=int(self.counts[1]),
        )


State = Callable[[_Run], Any]


def _warm_up(run: _Run) -> State:
    """Create populations of the posterior from draws of the prior (see `warm_up`)."""
    run.warm = run.store.once("warm_up", lambda: _populations(run))
    run.counts = run.counts + run.warm["counts"]
    return _fitted


def _populations(run: _Run) -> Arrays:
    try:
        populations, target = _warmed_up(run, run.problem.rough or run.problem)
    except EveryDrawFailed:
        if run.problem.rough is None:
            raise
        populations, target = _warmed_up(run, run.problem)
    return {
        "particles": populations.particles,
        "broad": populations.broad,
        "log_posterior": populations.log_density,
        "counts": target.counts,
    }


def _warmed_up(run: _Run, problem: Problem) -> tuple[Populations, Target]:
    settings, target = run.settings, Target(problem.log_likelihood, problem.split)
    shape = settings.ensembles, max(settings.particles, settings.walkers)
    return warm_up(problem, target, shape, run.stream(WARM_UP), run.progress), target


def _fitted(run: _Run) -> State:
    """Fit the proposal to the last two rounds' draws and, early on, to the warm-up's particles."""
    run.round = run.store.sub(f"round_{run.refits}")
    run.proposal = _proposal(run)
    run.counts = run.counts + sum((chunk["counts"] for chunk in run.chunks), np.zeros(2))
    run.goal = int(FIRST_ROUND * GROWTH**run.refits)
    return _sampling


def _proposal(run: _Run) -> Proposal:
    dimension = run.problem.dimension
    draws = list(run.earlier[-2:])
    if run.refits <= PARTICLES_UNTIL:
        warm = run.warm["particles"].reshape(-1, dimension), run.warm["log_posterior"].ravel()
        draws.insert(0, warm)
    z, log_posterior = (np.concatenate(parts) for parts in zip(*draws, strict=True))
    rng = np.random.default_rng(run.stream(FIT, run.refits))
    return fit(z, COMPONENTS, rng, log_posterior, coordinates=run.problem.coordinates)


def _sampling(run: _Run) -> State:
    """Sample to the round's goal, or to the end of the budget, chunk by chunk."""
    goal = min(run.goal, run.steps + run.left)
    if run.steps >= goal:
        return _judged
    assert run.proposal is not None
    settings, target = run.settings, Target(run.problem.log_likelihood)
    moves = recipe((run.proposal,), run.problem.hops, settings.ensembles)
    shape = settings.ensembles * settings.walkers, run.problem.dimension
    sampler = EnsembleSampler(*shape, target, moves=moves, vectorize=True)
    began, first = time.monotonic(), run.steps
    while run.steps < goal:
        before = target.counts
        length = min(CHUNK, -(-(goal - run.steps) // run.thin))
        chunk = _chunk(run, target, sampler, length)
        chunk["counts"] = target.counts - before
        run.counts = run.counts + chunk["counts"]
        run.round.append(chunk)
        run.seconds = (time.monotonic() - began) / (run.steps - first)
        _say(run, "sampling")
    return _judged


def _chunk(run: _Run, target: Target, sampler: Any, length: int) -> Arrays:
    sampler.reset()
    steps = sampler.sample(
        _last_state(run, target), iterations=length, thin_by=run.thin, skip_initial_state_check=True
    )
    for state in steps:
        after = state
    return {
        "chain": sampler.get_chain().copy(),
        "log_posterior": sampler.get_log_prob().copy(),
        "accepted": np.asarray(sampler.backend.accepted.mean()),
        **random_state_arrays(after.random_state),
    }


def _last_state(run: _Run, target: Target) -> Any:
    """Return the walkers from which this round continues or starts.

    A round starts at the last step of the previous round. The first round starts at the warm-up's
    particles.
    """
    if run.chunks:
        last = run.chunks[-1]
        state = Walkers(last["chain"][-1], log_prob=last["log_posterior"][-1], copy=True)
        state.random_state = random_state_from(last)
        return state
    if run.last is not None:
        z, log_posterior = run.last["chain"][-1], run.last["log_posterior"][-1]
    else:
        z = _first_walkers(run, target)
        log_posterior = target(z)
    random = np.random.RandomState(np.random.MT19937(run.stream(SAMPLING, run.refits)))
    return Walkers(z, log_prob=log_posterior, random_state=random.get_state(), copy=True)


def _first_walkers(run: _Run, target: Target) -> FloatArray:
    """Return walkers (E W, d) from the particles, half of them over-dispersed.

    A walker without a finite density is replaced by a particle.
    """
    walkers = run.warm["particles"][:, : run.settings.walkers].copy()
    half = run.settings.walkers // 2
    walkers[:, :half] = run.warm["broad"][:, :half]
    z = walkers.reshape(-1, run.problem.dimension)
    lost = ~np.isfinite(target(z))
    z[lost] = run.warm["particles"][:, : run.settings.walkers].reshape(z.shape)[lost]
    return z


def _judged(run: _Run) -> State | None:
    """Apply the gates; sample on, fit a new proposal, or end."""
    run.convergence = _verdict(run)
    further = _further_goal(run) if run.convergence.converged else None
    if further is not None:
        run.goal = further
        return _sampling
    if run.convergence.converged or run.left <= 0:
        run.needed = 0.0
        _say(run, "converged" if run.convergence.converged else "NOT converged, budget used")
        return None
    if run.convergence.has_stuck and run.refits < MOST_REFITS:
        _say(run, "moving stuck walkers")
        return _refitted
    times = max(run.convergence.length, 0.1)
    run.needed = MARGIN * run.steps * run.settings.autocorrelation_times / times
    run.needed = max(run.needed, LEAST_GROWTH * run.steps)
    if run.needed > PATIENCE * run.steps and run.refits < MOST_REFITS:
        _say(run, "fitting a better proposal")
        return _refitted
    run.goal = int(min(run.needed, PATIENCE * run.steps))
    return _sampling


def _further_goal(run: _Run) -> int | None:
    """Return the steps to which a run that passes its gates should continue, or None.

    The run continues to `AIM` while it has used fewer than `AFFORDABLE` evaluations.
    """
    assert run.convergence is not None
    ess = run.convergence.smallest_ess
    if ess >= AIM or run.counts[0] >= AFFORDABLE or run.left <= 0:
        return None
    wanted = max(MARGIN * AIM / ess, LEAST_GROWTH) * run.steps
    walkers = run.settings.ensembles * run.settings.walkers
    return int(min(wanted, run.steps + (AFFORDABLE - run.counts[0]) / walkers)) + 1


def _refitted(run: _Run) -> State:
    """Begin a new round; the draws of the current round only serve to fit proposals.

    Stuck walkers restart at the positions of other walkers of their ensemble. Otherwise, one
    walker of 32 would stay forever in a mode with almost no mass.
    """
    z, log_posterior = run.draws(0.5)
    run.last = dict(run.chunks[-1])
    stuck = stuck_walkers(log_posterior)
    if stuck.any():
        rng = np.random.default_rng(run.stream(RESTART, run.refits))
        source = np.arange(stuck.size).reshape(stuck.shape)
        for which, walkers in zip(stuck, source, strict=True):
            if not which.all():
                walkers[which] = rng.choice(walkers[~which], which.sum())
        for name in ("chain", "log_posterior"):
            run.last[name] = run.last[name][:, source.ravel()]
    kept = np.broadcast_to(~stuck[:, None], log_posterior.shape)
    run.earlier.append((z[kept], log_posterior[kept]))
    run.steps_before += run.steps
    run.refits += 1
    return _fitted


def _verdict(run: _Run) -> Convergence:
    """Apply the gates to the coordinates of z until these pass, then to every quantity."""
    draws, log_posterior = run.draws(1.0 - DROPPED)
    kept = chains.thin_evenly(draws.shape[1], GATE_STEPS)
    draws, log_posterior = draws[:, kept], log_posterior[:, kept]
    flat = draws.reshape(-1, draws.shape[3])
    of_coordinates = assess({str(k): draws[..., k] for k in range(draws.shape[3])}, run.settings)
    if not of_coordinates.converged and run.left > 0:
        return of_coordinates
    named = run.problem.quantities(flat)
    return assess(
        {name: np.asarray(values).reshape(draws.shape[:3]) for name, values in named.items()},
        run.settings,
        log_posterior=log_posterior,
        draws=draws,
    )


def _say(run: _Run, state: str) -> None:
    ess = r_hat = left = None
    if run.convergence is not None:
        ess, r_hat = run.convergence.smallest_ess, float(run.convergence.table["r_hat"].max())
    if run.needed and run.seconds:
        left = max(run.needed - run.steps, 0.0) * run.seconds
    run.progress.say(state, run.steps_before + run.steps, ess, r_hat, left)
