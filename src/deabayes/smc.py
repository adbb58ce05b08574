"""Tempered sequential Monte Carlo: from the prior to a posterior, or between posteriors.

A population is carried from a base density to base times increment along
base(z) * increment(z)^beta (Del Moral, Doucet and Jasra 2006, J. R. Stat. Soc. B 68, 411).
Its spread tends to be too narrow and its evidence too low: it starts ensembles and
re-weights posteriors, and nothing of it is published as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.mixture import RandomSource
from deabayes.proposal import Proposal, fit

LogDensity = Callable[[FloatArray], FloatArray]
Report = Callable[[float, int], None]
Hop = Callable[[FloatArray, RandomSource], tuple[FloatArray, FloatArray]]
"""z (W, d) -> proposed z' (W, d), log of the factor that N(z')/N(z) is multiplied by (W,)."""

REFIT_ROUNDS = 5


@dataclass(frozen=True)
class Schedule:
    """How a population is moved: rounds go on until it has forgotten where it started.

    Attributes
    ----------
    effective_share : effective share of the particles that the next beta leaves.
    forgotten : largest correlation of any coordinate with its start at which rounds
        end, on the way and (`final_`) at beta = 1.
    """

    effective_share: float = 0.5
    components: int = 4
    forgotten: float = 0.5
    rounds: tuple[int, int] = (2, 15)
    final_forgotten: float = 0.1
    final_rounds: tuple[int, int] = (10, 60)


@dataclass(frozen=True)
class Population:
    """Equally weighted particles at the end of a schedule.

    Attributes
    ----------
    particles : (P, d); `broad` (P, d) are those of the last step before, which are
        over-dispersed with respect to the final density, and `early` (P, d) those half
        way through the schedule.
    log_base, log_increment : (P,) at `particles`.
    log_evidence : estimate of the log of the ratio of normalising constants.
    betas : the schedule, from 0 to 1.
    """

    particles: FloatArray
    broad: FloatArray
    early: FloatArray
    log_base: FloatArray
    log_increment: FloatArray
    log_evidence: float
    betas: tuple[float, ...]
    rounds: int


def log_standard_normal(z: FloatArray) -> FloatArray:
    """Log density of N(0, I) at z (W, d): the prior of every model in its z coordinates."""
    return -0.5 * np.einsum("wd,wd->w", z, z) - 0.5 * z.shape[1] * log(2 * pi)


def from_prior(
    log_likelihood: LogDensity,
    dimension: int,
    particles: int,
    rng: np.random.Generator,
    schedule: Schedule | None = None,
    report: Report | None = None,
    hop: Hop | None = None,
) -> Population:
    """Carry a population from the prior N(0, I) to the posterior; see `anneal`."""
    start = rng.standard_normal((particles, dimension))
    return anneal(start, log_standard_normal, log_likelihood, rng, schedule, report, hop)


def settle(
    particles: FloatArray,
    log_density: LogDensity,
    rng: np.random.Generator,
    schedule: Schedule | None = None,
    hop: Hop | None = None,
) -> Population:
    """Move particles (P, d) that are already about the density of interest."""
    return anneal(particles, log_density, lambda z: np.zeros(len(z)), rng, schedule, hop=hop)


def anneal(
    particles: FloatArray,
    log_base: LogDensity,
    log_increment: LogDensity,
    rng: np.random.Generator,
    schedule: Schedule | None = None,
    report: Report | None = None,
    hop: Hop | None = None,
) -> Population:
    """Carry particles (P, d), draws of base, to draws of base * increment.

    To leave an experiment out, base is the full posterior and the increment minus the
    experiment's log-likelihood; the way back swaps them. The estimated ratio of
    normalising constants is the product over the schedule of mean increments^(step).

    Parameters
    ----------
    log_base, log_increment : (W, d) -> (W,); NaN or -inf where a density is zero.
    report : called after every step with beta and the number of rounds so far.
    hop : a further proposal, made in every round; base must hold the factor N(z; 0, I).

    Raises
    ------
    UserError : when the increment is zero at every particle.
    """
    schedule = schedule or Schedule()
    cloud = _Cloud(particles.copy(), log_base, log_increment, rng, hop)
    betas, ratio, rounds = [0.0], 0.0, 0
    passed = [cloud.z.copy()]
    while betas[-1] < 1.0:
        step, log_mean = _next_step(cloud.increment, 1.0 - betas[-1], schedule.effective_share)
        betas.append(1.0 if step >= 1.0 - betas[-1] else betas[-1] + step)
        ratio += log_mean
        passed.append(cloud.z.copy())
        proposal = fit(cloud.z, schedule.components, rng)
        cloud.resample(step)
        rounds += cloud.forget(betas[-1], schedule, proposal)
        if report is not None:
            report(betas[-1], rounds)
    broad, early = passed[-1], passed[len(passed) // 2]
    return Population(
        cloud.z, broad, early, cloud.base, cloud.increment, float(ratio), tuple(betas), rounds
    )


def _next_step(increment: FloatArray, remaining: float, share: float) -> tuple[float, float]:
    """The step in beta that leaves the wanted effective share, and the log mean weight."""
    finite = np.isfinite(increment)
    if not finite.any():
        raise UserError(
            "no particle has a finite likelihood: every draw of the prior failed; "
            "check the units of the records and the priors"
        )
    centred = increment[finite] - increment[finite].max()

    def effective(step: float) -> float:
        weights = np.exp(step * centred)
        return float(weights.sum() ** 2 / (weights**2).sum() / len(weights))

    low, high = 0.0, remaining
    if effective(remaining) < share:
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if effective(middle) > share else (low, middle)
    step = high
    log_mean = np.log(np.exp(step * centred).sum() / len(increment))
    return step, float(log_mean + step * increment[finite].max())


def _systematic(weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices of systematic resampling."""
    points = (np.arange(len(weights)) + rng.random()) / len(weights)
    cumulative = np.cumsum(weights) / weights.sum()
    return np.minimum(np.searchsorted(cumulative, points, side="right"), len(weights) - 1)


class _Cloud:
    """Particles with their densities, and the moves that leave base * increment^beta alone."""

    def __init__(
        self,
        z: FloatArray,
        log_base: LogDensity,
        log_increment: LogDensity,
        rng: np.random.Generator,
        hop: Hop | None = None,
    ) -> None:
        self.z, self.rng, self._hop = z, rng, hop
        self._log_base, self._log_increment = log_base, log_increment
        self.base, self.increment = self._densities(z)

    def _densities(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        base = np.asarray(self._log_base(z), dtype=float)
        increment = np.asarray(self._log_increment(z), dtype=float)
        usable = np.isfinite(base) & np.isfinite(increment)
        return np.where(usable, base, -np.inf), np.where(usable, increment, -np.inf)

    def resample(self, step: float) -> None:
        usable = np.isfinite(self.increment)
        largest = self.increment[usable].max()
        chosen = _systematic(np.exp(step * (self.increment - largest)), self.rng)
        self.z, self.base = self.z[chosen], self.base[chosen]
        self.increment = self.increment[chosen]

    def forget(self, beta: float, schedule: Schedule, proposal: Proposal) -> int:
        """Move until the start is forgotten; the number of rounds made.

        The proposal is that of the density before: wider, and fitted to particles of which
        none is another's copy. It is refitted as rounds go on.
        """
        last = beta == 1.0
        fewest, most = schedule.final_rounds if last else schedule.rounds
        limit = schedule.final_forgotten if last else schedule.forgotten
        start = self.z.copy()
        for made in range(1, most + 1):
            if made % REFIT_ROUNDS == 0:
                proposal = fit(self.z, schedule.components, self.rng)
            self._differential_evolution(beta)
            self._independence(beta, proposal)
            if self._hop is not None:
                proposed, factor = self._hop(self.z, self.rng)
                self._accept(np.arange(len(self.z)), proposed, factor, beta)
            if made >= fewest and _largest_correlation(start, self.z) < limit:
                return made
        return most

    def _accept(
        self, which: NDArray[np.intp], proposed: FloatArray, factor: FloatArray, beta: float
    ) -> None:
        base, increment = self._densities(proposed)
        usable = np.isfinite(base)
        target = np.where(usable, base + beta * np.where(usable, increment, 0.0), -np.inf)
        current = self.base[which] + beta * self.increment[which]
        accepted = np.log(self.rng.random(len(which))) < target - current + factor
        moved = which[accepted]
        self.z[moved] = proposed[accepted]
        self.base[moved], self.increment[moved] = base[accepted], increment[accepted]

    def _differential_evolution(self, beta: float) -> None:
        """Each half moves along differences of pairs of the other (ter Braak 2006)."""
        count, dimension = self.z.shape
        order = self.rng.permutation(count)
        halves = order[: count // 2], order[count // 2 :]
        for moving, resting in (halves, halves[::-1]):
            first = self.rng.integers(len(resting), size=len(moving))
            second = (first + self.rng.integers(1, len(resting), size=len(moving))) % len(resting)
            jump = self.rng.random(len(moving)) < 0.1
            gamma = np.where(jump, 1.0, 2.38 / sqrt(2 * dimension))
            gamma = gamma * (1 + 1e-5 * self.rng.standard_normal(len(moving)))
            step = self.z[resting[first]] - self.z[resting[second]]
            noise = 1e-9 * self.rng.standard_normal(step.shape)
            proposed = self.z[moving] + gamma[:, None] * step + noise
            self._accept(moving, proposed, np.zeros(len(moving)), beta)

    def _independence(self, beta: float, proposal: Proposal) -> None:
        proposed = proposal.sample(self.rng, len(self.z))
        factor = proposal.log_density(self.z) - proposal.log_density(proposed)
        self._accept(np.arange(len(self.z)), proposed, factor, beta)


def _largest_correlation(start: FloatArray, now: FloatArray) -> float:
    """Largest absolute correlation of a coordinate with its own start."""
    first, second = start - start.mean(axis=0), now - now.mean(axis=0)
    norm = np.sqrt((first**2).sum(axis=0) * (second**2).sum(axis=0))
    return float(np.max(np.abs((first * second).sum(axis=0)) / np.maximum(norm, 1e-300)))
