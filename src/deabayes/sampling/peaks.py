"""The peaks of a posterior, climbed to from draws of the prior, many at once.

Records with little noise make a posterior a thin curved sheet in which tempered particles get
lost, tens of nats below the bulk. Climbs are quick. Each is made in coordinates whitened by the
curvature at its start, and again at where it has led.

Where few climbs have come to the highest peak, further waves of climbs start at the best ones with
some of their coordinates drawn anew: of parts that fit well, such as two units of three, these keep
some.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.laplace import Points, laplace_factors
from deabayes.sampling.problem import LogDensity
from deabayes.sampling.tempering import EveryDrawFailed

STARTS, FINISHED, TURNS = 64, 16, 3
"""Of a wave: starts; how many of these climbs are finished; and how often their coordinates are
made anew."""
PARENTS, REDRAWN = 4, 0.3
"""Peaks that a further wave starts at, and the share of coordinates drawn anew."""
CONFIRMED, MOST_WAVES = 4, 4
"""Climbs that have come to the highest peak when no further wave is made; and most waves."""
DIP = 1.0
"""Nats that the density falls by half way between climbs that are at different peaks."""
SHORT, LONG = 20, 30
"""Iterations of a climb from a start, and of one in each turn."""
NEAR = 10.0
"""Nats that a peak, or its Laplace evidence, may be below the largest for draws to start from it.
Climbs along a ridge end a few apart."""
DIFFERENCE = 1e-3
"""Of the gradient, in standard deviations of the start's coordinates."""
LENGTHS = np.array([2.0, 1.0, 0.5, 0.2, 0.05, 0.01, 1e-3])
"""Of a step, tried side by side."""
LONGEST = 10.0
GAIN, QUIET = 1e-3, 3
"""Nats that an iteration gains at least; after so many that do not the climb has ended."""


def peaks(target: LogDensity, dimension: int, rng: np.random.Generator) -> Points:
    """The highest peaks found, from the highest one down.

    Raises
    ------
    EveryDrawFailed : the density is zero at every start.
    """
    found = _wave(target, rng.standard_normal((STARTS, dimension)))
    for _ in range(MOST_WAVES - 1):
        if (found.value > found.value[0] - DIP).sum() >= CONFIRMED:
            break
        parents = found.z[np.arange(STARTS) % min(PARENTS, len(found.z))]
        anew = rng.random(parents.shape) < REDRAWN
        starts = np.where(anew, rng.standard_normal(parents.shape), parents)
        found = Points.joined(found, _wave(target, starts))
        found = found.at(np.argsort(-found.value))
    top, mass = found.value.max(), found.log_mass
    return found.at((found.value > top - NEAR) | (mass > mass.max() - NEAR))


def _wave(target: LogDensity, starts: FloatArray) -> Points:
    """Climbs from starts (K, d): short ones of all, then those that promise most to their ends."""
    every = np.tile(np.eye(starts.shape[1]), (len(starts), 1, 1))
    z, value = climb(target, starts, every, SHORT)
    usable = np.isfinite(value)
    if not usable.any():
        raise EveryDrawFailed("no draw of the prior has a finite likelihood")
    z = z[usable]
    z = z[_promising(target, z, value[usable])]
    for _ in range(TURNS):
        z, value = climb(target, z, laplace_factors(target, z, every[: len(z)]), LONG)
    factors = laplace_factors(target, z, every[: len(z)])
    order = np.argsort(-value)
    return Points(z[order], factors[order], value[order])


def _promising(target: LogDensity, z: FloatArray, value: FloatArray) -> NDArray[np.intp]:
    """Climbs (K, d) to finish: half of them the highest, the others the highest of other peaks.

    Many climbs end at one peak, and would leave no place for another that is a little lower.
    """
    order = np.argsort(-value)
    low, high = np.tril_indices(len(z), -1)
    middles = 0.5 * (z[order[low]] + z[order[high]])
    apart = np.zeros((len(z), len(z)), dtype=bool)
    apart[low, high] = ~(target(middles) > value[order[low]] - DIP)
    chosen = list(range(min(FINISHED // 2, len(z))))
    for k in range(len(chosen), len(z)):
        if len(chosen) < FINISHED and apart[k, chosen].all():
            chosen.append(k)
    rest = [k for k in range(len(z)) if k not in chosen]
    return order[(chosen + rest)[:FINISHED]]


def climb(
    target: LogDensity, starts: FloatArray, factors: FloatArray, iterations: int
) -> tuple[FloatArray, FloatArray]:
    """Maximise by the rule of Broyden, Fletcher, Goldfarb and Shanno, all climbs in lockstep.

    An iteration is two calls: steps of several lengths for all climbs, and their gradients. These
    are differences to one side: a climb may end a tenth of a nat below a curved ridge's top.

    Parameters
    ----------
    starts : (K, d).
    factors : (K, d, d), steps are taken in u with z = start + factor u. A factor without full rank
        keeps the climb in the plane of its columns.

    Returns
    -------
    z (K, d), and the log density there (K,).
    """
    climbs = _Climbs(target, starts, factors)
    for _ in range(iterations):
        if not climbs.live.size:
            break
        climbs.advance()
    return climbs.place(np.arange(len(starts)), climbs.u[:, None])[:, 0], climbs.value


@dataclass
class _Climbs:
    """Where K climbs are, with gradients and inverse Hessians of minus the log density in u."""

    target: LogDensity
    starts: FloatArray
    factors: FloatArray

    def __post_init__(self) -> None:
        count, d = self.starts.shape
        self.shifts = DIFFERENCE * np.eye(d)
        self.u = np.zeros((count, d))
        self.inverse = np.tile(np.eye(d), (count, 1, 1))
        self.quiet = np.zeros(count, dtype=int)
        every = np.arange(count)
        self.value = self._at(every, self.u[:, None])[:, 0]
        self.live = np.flatnonzero(np.isfinite(self.value))
        self.slope = np.zeros((count, d))
        self.slope[self.live] = self._gradient(self.live)

    def place(self, which: NDArray[np.intp], u: FloatArray) -> FloatArray:
        """z (K, M, d) of u (K, M, d), in the coordinates of the climbs `which`."""
        steps = np.matmul(u, self.factors[which].transpose(0, 2, 1))
        return np.asarray(self.starts[which][:, None] + steps)

    def _at(self, which: NDArray[np.intp], u: FloatArray) -> FloatArray:
        """Log densities (K, M)."""
        values = self.target(self.place(which, u).reshape(-1, u.shape[2]))
        return np.where(np.isfinite(values), values, -np.inf).reshape(u.shape[:2])

    def _gradient(self, which: NDArray[np.intp]) -> FloatArray:
        """By differences to one side; where that fails, none."""
        up = self._at(which, self.u[which][:, None] + self.shifts)
        slope = (up - self.value[which][:, None]) / DIFFERENCE
        return np.where(np.isfinite(slope), slope, 0.0)

    def advance(self) -> None:
        """One iteration of the climbs that have not ended."""
        live = self.live
        way = np.einsum("kij,kj->ki", self.inverse[live], self.slope[live])
        size = np.linalg.norm(way, axis=1, keepdims=True)
        way *= np.minimum(1.0, LONGEST / np.maximum(size, 1e-300))
        trial = self.u[live][:, None] + LENGTHS[:, None] * way[:, None]
        found = self._at(live, trial)
        rows, best = np.arange(live.size), found.argmax(axis=1)
        gain = found[rows, best] - self.value[live]
        self.quiet[live] = np.where(gain > GAIN, 0, self.quiet[live] + 1)
        better = gain > 0.0
        self.inverse[live[~better]] = np.eye(self.u.shape[1])  # this way led nowhere: begin anew
        step, rising = (trial[rows, best] - self.u[live])[better], live[better]
        self.u[rising] += step
        self.value[rising] = found[rows, best][better]
        if rising.size:
            before = self.slope[rising].copy()
            self.slope[rising] = self._gradient(rising)
            self._update(rising, step, before - self.slope[rising])
        self.live = live[self.quiet[live] < QUIET]

    def _update(self, which: NDArray[np.intp], step: FloatArray, change: FloatArray) -> None:
        """The rule's inverse Hessians after steps (K, d) that changed the slope by so much."""
        curvature = np.einsum("ki,ki->k", step, change)
        norms = np.linalg.norm(step, axis=1) * np.linalg.norm(change, axis=1)
        usable = curvature > 1e-10 * norms
        k, s, y, r = which[usable], step[usable], change[usable], 1.0 / curvature[usable]
        hy = np.einsum("kij,kj->ki", self.inverse[k], y)
        square = r * (1.0 + r * np.einsum("ki,ki->k", y, hy))
        self.inverse[k] += square[:, None, None] * s[:, :, None] * s[:, None]
        both = hy[:, :, None] * s[:, None] + s[:, :, None] * hy[:, None]
        self.inverse[k] -= r[:, None, None] * both
