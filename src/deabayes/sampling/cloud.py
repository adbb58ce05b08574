"""Particles on their way, and the moves that leave base * increment^beta alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.guide import Guide
from deabayes.sampling.proposal import Lines, Proposal
from deabayes.sampling.proposal_fit import fit

LogDensity = Callable[[FloatArray], FloatArray]

REFIT_ROUNDS, STEADY_ROUNDS = 5, 5
SHORT_STEP = 0.2


@dataclass(frozen=True)
class Schedule:
    """How a population is moved: rounds go on until it has forgotten where it started.

    Attributes
    ----------
    effective_share : effective share of the particles that the next beta leaves.
    forgotten : largest correlation of any coordinate with its start at which rounds
        end, on the way and (`final_`) at beta = 1.
    drift : of the median log density over five rounds, in its standard deviations, below
        which rounds end. Particles that have forgotten where along a thin ridge they were
        may still be far down its side.
    crossed : independence proposals of each half of the particles are fitted to the other.
        Fitted to those that they move they draw them together a little at every step, and a
        ratio of normalising constants comes out too good (docs/statistics.md).
    """

    effective_share: float = 0.5
    components: int = 4
    forgotten: float = 0.5
    rounds: tuple[int, int] = (2, 60)
    final_forgotten: float = 0.1
    final_rounds: tuple[int, int] = (10, 60)
    drift: float = 0.1
    crossed: bool = False


class Cloud:
    """Particles with their densities, and the moves that leave base * increment^beta alone."""

    def __init__(
        self,
        z: FloatArray,
        log_base: LogDensity,
        log_increment: LogDensity,
        rng: np.random.Generator,
        guide: Guide,
    ) -> None:
        self.z, self.rng, self._guide = z, rng, guide
        self._log_base, self._log_increment = log_base, log_increment
        self.base, self.increment = self._densities(z)
        self._half = np.zeros(len(z), dtype=int)

    def _densities(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        base = np.asarray(self._log_base(z), dtype=float)
        increment = np.asarray(self._log_increment(z), dtype=float)
        usable = np.isfinite(base) & np.isfinite(increment)
        return np.where(usable, base, -np.inf), np.where(usable, increment, -np.inf)

    def proposals(self, schedule: Schedule) -> tuple[Proposal, ...]:
        """Fitted to the particles as they are: to all of them, or one to each half."""
        self._half = _dealt(self.z, self.rng) if schedule.crossed else np.zeros_like(self._half)
        halves = [self.z[self._half == half] for half in np.unique(self._half)]
        coordinates = self._guide.coordinates
        return tuple(fit(z, schedule.components, self.rng, coordinates=coordinates) for z in halves)

    def resample(self, step: float) -> None:
        usable = np.isfinite(self.increment)
        largest = self.increment[usable].max()
        chosen = systematic(np.exp(step * (self.increment - largest)), self.rng)
        self.z, self.base = self.z[chosen], self.base[chosen]
        self.increment, self._half = self.increment[chosen], self._half[chosen]

    def forget(self, beta: float, schedule: Schedule, proposals: Sequence[Proposal]) -> int:
        """Move until the start is forgotten; the number of rounds made.

        The proposals are those of the density before: wider, and fitted to particles of which
        none is another's copy. They are refitted as rounds go on.
        """
        last = beta == 1.0
        fewest, most = schedule.final_rounds if last else schedule.rounds
        limit = schedule.final_forgotten if last else schedule.forgotten
        start = self.z.copy()
        levels: list[tuple[float, float]] = []
        for made in range(1, most + 1):
            if made % REFIT_ROUNDS == 0:
                proposals = self.proposals(schedule)
            self._move(beta, proposals)
            density = self.base + beta * self.increment
            levels.append((float(np.median(density)), float(density.std())))
            forgotten = made >= fewest and _largest_correlation(start, self.z) < limit
            if forgotten and _steady(levels, schedule.drift):
                return made
        return most

    def _move(self, beta: float, proposals: Sequence[Proposal]) -> None:
        """One round: every kind of move once."""
        self._differential_evolution(beta)
        for half, proposal in enumerate(reversed(proposals)):
            self._independence(beta, proposal, np.flatnonzero(self._half == half))
        for _, lines in proposals[0].lines:
            self._along(beta, lines)
        for hop in self._guide.hops:
            proposed, factor = hop(self.z, self.rng)
            self._accept(np.arange(len(self.z)), proposed, factor, beta)

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
        lines = Lines(self._guide.coordinates)
        for moving, resting in self._halves():
            jump = self.rng.random(len(moving)) < 0.1
            self._step(beta, lines, moving, resting, np.where(jump, 1.0, self._usual))

    def _along(self, beta: float, lines: Lines) -> None:
        """The same in a map's straightened coordinates, half of it in short steps."""
        for moving, resting in self._halves():
            short = self.rng.random(len(moving)) < 0.5
            self._step(beta, lines, moving, resting, np.where(short, SHORT_STEP, self._usual))

    def _step(
        self,
        beta: float,
        lines: Lines,
        moving: NDArray[np.intp],
        resting: NDArray[np.intp],
        gamma: FloatArray,
    ) -> None:
        x, log_jacobian = lines.straighten(self.z[np.concatenate([moving, resting])])
        n = len(moving)
        proposed = x[:n] + self._differences(x[n:], gamma)
        self._accept(moving, *lines.moved(self.z[moving], log_jacobian[:n], proposed), beta)

    @property
    def _usual(self) -> float:
        return 2.38 / sqrt(2 * self.z.shape[1])

    def _halves(self) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]:
        """Indices of the particles that move and of those that rest, and the other way round."""
        order = self.rng.permutation(len(self.z))
        first, second = order[: len(order) // 2], order[len(order) // 2 :]
        return (first, second), (second, first)

    def _differences(self, resting: FloatArray, gamma: FloatArray) -> FloatArray:
        """Differences of random pairs of `resting` (R, d), one for each of gamma (M,): (M, d)."""
        first = self.rng.integers(len(resting), size=len(gamma))
        second = (first + self.rng.integers(1, len(resting), size=len(gamma))) % len(resting)
        gamma = gamma * (1 + 1e-5 * self.rng.standard_normal(len(gamma)))
        step = gamma[:, None] * (resting[first] - resting[second])
        return step + 1e-9 * self.rng.standard_normal(step.shape)

    def _independence(self, beta: float, proposal: Proposal, moving: NDArray[np.intp]) -> None:
        proposed = proposal.sample(self.rng, len(moving))
        factor = proposal.log_density(self.z[moving]) - proposal.log_density(proposed)
        self._accept(moving, proposed, factor, beta)


def systematic(weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Systematic resampling: indices (K,) that repeat each particle as its weight (K,) says."""
    points = (np.arange(len(weights)) + rng.random()) / len(weights)
    cumulative = np.cumsum(weights) / weights.sum()
    return np.minimum(np.searchsorted(cumulative, points, side="right"), len(weights) - 1)


def _dealt(z: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Which of two halves each particle (P, d) is of, (P,); copies are of the same.

    All are of one where they are copies of too few to fit two proposals to.
    """
    _, copies = np.unique(z, axis=0, return_inverse=True)
    different = int(copies.max()) + 1
    halves = 2 if different >= 4 * z.shape[1] else 1
    return np.asarray(rng.permutation(different)[copies] % halves)


def _steady(levels: Sequence[tuple[float, float]], drift: float) -> bool:
    """Whether medians, with standard deviations, have stood still for some rounds."""
    if len(levels) <= STEADY_ROUNDS:
        return False
    (median, spread), (before, _) = levels[-1], levels[-1 - STEADY_ROUNDS]
    return abs(median - before) <= drift * spread


def _largest_correlation(start: FloatArray, now: FloatArray) -> float:
    """Largest absolute correlation of a coordinate with its own start."""
    first, second = start - start.mean(axis=0), now - now.mean(axis=0)
    norm = np.sqrt((first**2).sum(axis=0) * (second**2).sum(axis=0))
    return float(np.max(np.abs((first * second).sum(axis=0)) / np.maximum(norm, 1e-300)))
