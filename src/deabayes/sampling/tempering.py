"""Tempered sequential Monte Carlo of several populations in lockstep.

Populations move from a base density to base times increment along
base(z) * increment(z)^beta (Del Moral, Doucet and Jasra 2006, J. R. Stat. Soc. B 68, 411). Each
population has its own particles. All populations share beta, so that one call of a density
evaluates all particles. The particles tend to spread too little. They only start ensembles and
re-weight posteriors, and are never published directly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from emcee.state import State
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.moves import recipe
from deabayes.sampling.problem import Coordinates, EveryDrawFailed, Hop, LogDensity
from deabayes.sampling.proposal import Proposal, fit

Report = Callable[[float, int], None]

REFIT_ROUNDS = 5
COMPONENTS = 4


@dataclass(frozen=True)
class Schedule:
    """Settings that decide how populations are moved at each beta.

    Attributes
    ----------
    effective_share : share of effective particles that the next beta leaves in the worst
        population.
    forgotten : rounds end when no coordinate has a larger correlation with its start. The value
        with `final_` applies at beta = 1, the other one before.
    rounds : fewest and most rounds.
    crossed : whether each half of the populations is moved by proposals fitted to the other half.
        Proposals fitted to the particles that they move contract them a little at every step. The
        estimated ratio of normalising constants is then too good.
    """

    effective_share: float = 0.5
    forgotten: float = 0.5
    rounds: tuple[int, int] = (2, 20)
    final_forgotten: float = 0.1
    final_rounds: tuple[int, int] = (5, 60)
    crossed: bool = False


@dataclass(frozen=True)
class Populations:
    """Equally weighted particles at the end of a schedule.

    Attributes
    ----------
    particles : (E, P, d). `broad` (E, P, d) are the particles one step earlier, which are
        over-dispersed with respect to the final density.
    log_density : log density of base times increment, (E, P).
    log_evidence : estimates (E,) of the log ratio of normalising constants.
    betas : the schedule, from 0 to 1.
    """

    particles: FloatArray
    broad: FloatArray
    log_density: FloatArray
    log_evidence: FloatArray
    betas: tuple[float, ...]
    rounds: int


class _Model(NamedTuple):
    """The attributes of emcee's model that the moves use."""

    compute_log_prob_fn: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    random: np.random.RandomState


def temper(
    start: FloatArray,
    log_base: LogDensity,
    log_increment: LogDensity,
    seed: np.random.SeedSequence,
    schedule: Schedule | None = None,
    coordinates: Coordinates | None = None,
    hops: Sequence[Hop] = (),
    report: Report | None = None,
    log_final: LogDensity | None = None,
) -> Populations:
    """Turn populations (E, P, d) of draws from base into draws from base * increment.

    The estimated ratio of normalising constants is the product over all steps of the mean of
    increment^(step).

    Parameters
    ----------
    log_base, log_increment : (N, d) -> (N,); NaN or -inf where a density is zero. The rows of one
        population follow those of another, equally many of each.
    hops : proposals between modes; they require that base contains the factor N(z; 0, I).
    report : called after every step with beta and the number of rounds so far.
    log_final : log_base + log_increment, if one call is cheaper than two.

    Raises
    ------
    EveryDrawFailed : if the increment is zero at every particle of a population.
    """
    schedule, coordinates = schedule or Schedule(), coordinates or Coordinates()
    cloud = _Cloud(start, log_base, log_increment, log_final, seed, coordinates, hops)
    betas, ratio, rounds = [0.0], np.zeros(len(start)), 0
    broad = cloud.particles
    while betas[-1] < 1.0:
        step, log_mean = _next_step(cloud.increments, 1.0 - betas[-1], schedule.effective_share)
        betas.append(1.0 if step >= 1.0 - betas[-1] else betas[-1] + step)
        ratio += log_mean
        broad, proposals = cloud.particles, cloud.proposals(schedule.crossed)
        cloud.resample(step)
        cloud.beta = betas[-1]
        rounds += cloud.forget(schedule, proposals)
        if report is not None:
            report(betas[-1], rounds)
    density = cloud.state.log_prob.reshape(start.shape[:2])
    return Populations(cloud.particles, broad, density, ratio, tuple(betas), rounds)


class _Cloud:
    """Particles of all populations, with their densities, and the moves at one beta.

    The state's `log_prob` is log base + beta log increment. Its `blobs` are log increment. At
    beta = 1 no particle is re-weighted any more, and `blobs` may be anything.
    """

    def __init__(
        self,
        start: FloatArray,
        log_base: LogDensity,
        log_increment: LogDensity,
        log_final: LogDensity | None,
        seed: np.random.SeedSequence,
        coordinates: Coordinates,
        hops: Sequence[Hop],
    ) -> None:
        self.shape, self.beta = start.shape, 0.0
        self._log_base, self._log_increment, self._log_final = log_base, log_increment, log_final
        self._coordinates, self._hops = coordinates, hops
        of_moves, of_fits = seed.spawn(2)
        self._model = _Model(self._density, np.random.RandomState(np.random.MT19937(of_moves)))
        self._rng = np.random.default_rng(of_fits)
        z = start.reshape(-1, start.shape[2])
        log_prob, increment = self._density(z)
        self.state = State(z, log_prob=log_prob, blobs=increment, copy=True)

    @property
    def particles(self) -> FloatArray:
        return np.array(self.state.coords).reshape(self.shape)

    @property
    def increments(self) -> FloatArray:
        return np.asarray(self.state.blobs).reshape(self.shape[:2])

    def _density(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.beta == 1.0 and self._log_final is not None:
            final = np.asarray(self._log_final(z), dtype=float)
            return np.where(np.isfinite(final), final, -np.inf), final
        base = np.asarray(self._log_base(z), dtype=float)
        increment = np.asarray(self._log_increment(z), dtype=float)
        usable = np.isfinite(base) & np.isfinite(increment)
        if self.beta == 0.0:  # the particles are draws of base, even where the increment is zero
            return base, np.where(usable, increment, -np.inf)
        with np.errstate(invalid="ignore"):
            return np.where(usable, base + self.beta * increment, -np.inf), increment

    def proposals(self, crossed: bool) -> tuple[Proposal, ...]:
        """Return one proposal fitted to all particles, or one per population if `crossed`.

        A crossed proposal is fitted to the half of the populations that it does not move.
        """
        if not crossed:
            return (self._fit(self.particles, COMPONENTS),)
        even, odd = (self._fit(self.particles[half::2], 1) for half in (0, 1))
        return tuple((odd, even)[e % 2] for e in range(self.shape[0]))

    def _fit(self, particles: FloatArray, components: int) -> Proposal:
        z = particles.reshape(-1, self.shape[2])
        return fit(z, components, self._rng, coordinates=self._coordinates)

    def resample(self, step: float) -> None:
        """Resample the particles of each population with the weights increment^step."""
        chosen, count = [], self.shape[1]
        for index, increment in enumerate(self.increments):
            weights = np.exp(step * (increment - increment.max()))
            chosen.append(index * count + systematic(weights, self._rng))
        which, before = np.concatenate(chosen), self.state
        log_prob = before.log_prob[which] + step * before.blobs[which]
        self.state = State(
            before.coords[which], log_prob=log_prob, blobs=before.blobs[which], copy=True
        )

    def forget(self, schedule: Schedule, proposals: tuple[Proposal, ...]) -> int:
        """Move the particles until they have forgotten their start; return the number of rounds.

        The first proposals were fitted before the resampling, to a wider density and to particles
        without copies. Later rounds refit them.
        """
        last = self.beta == 1.0
        fewest, most = schedule.final_rounds if last else schedule.rounds
        limit = schedule.final_forgotten if last else schedule.forgotten
        start = self.particles
        for made in range(1, most + 1):
            if made % REFIT_ROUNDS == 0:
                proposals = self.proposals(schedule.crossed)
            moves = recipe(proposals, self._hops, self.shape[0], plain=True)
            for move, _ in moves:
                self.state, _ = move.propose(self._model, self.state)
            if made >= fewest and _largest_correlation(start, self.particles) < limit:
                return made
        return most


def systematic(weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return indices (K,) that repeat each particle by its weight (K,): systematic resampling."""
    points = (np.arange(len(weights)) + rng.random()) / len(weights)
    cumulative = np.cumsum(weights) / weights.sum()
    return np.minimum(np.searchsorted(cumulative, points, side="right"), len(weights) - 1)


def _next_step(increments: FloatArray, remaining: float, share: float) -> tuple[float, FloatArray]:
    """Return the step in beta that leaves the wanted effective share, and log mean weights (E,)."""
    finite = np.isfinite(increments)
    if not finite.any(axis=1).all():
        raise EveryDrawFailed(
            "no particle has a finite likelihood: every draw of the prior failed; "
            "check the units of the records and the priors"
        )
    largest = increments.max(axis=1, keepdims=True)
    centred = np.where(finite, increments - largest, -np.inf)

    def effective(step: float) -> float:
        weights = np.exp(step * centred)
        sizes = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1)
        return float((sizes / finite.sum(axis=1)).min())

    low, high = 0.0, remaining
    if effective(remaining) < share:
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if effective(middle) > share else (low, middle)
    log_mean = np.log(np.exp(high * centred).mean(axis=1))
    return high, log_mean + high * largest[:, 0]


def _largest_correlation(start: FloatArray, now: FloatArray) -> float:
    """Largest absolute correlation of a coordinate with its own start, all populations pooled."""
    first = start - start.mean(axis=1, keepdims=True)
    second = now - now.mean(axis=1, keepdims=True)
    norm = np.sqrt((first**2).sum(axis=(0, 1)) * (second**2).sum(axis=(0, 1)))
    return float(np.max(np.abs((first * second).sum(axis=(0, 1))) / np.maximum(norm, 1e-300)))
