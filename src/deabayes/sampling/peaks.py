"""Find the peaks of a posterior by many simultaneous climbs from draws of the prior.

If the records have little noise, the posterior is a thin curved sheet. Tempered particles get lost
there, tens of nats below the bulk. Climbs are quick.

If few climbs reach the highest peak, further waves of climbs start at the best peaks, with some
coordinates drawn anew. Such a start may keep parts that fit well, such as two units of three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.problem import (
    Coordinates,
    EveryDrawFailed,
    Split,
    Target,
    log_standard_normal,
)

STARTS, KEPT = 64, 16
"""Starts of a wave, and how many ends of its climbs are kept."""
NEAR_STARTS = 16
"""Starts drawn from a similar posterior, if there is one, and as many from the prior."""
PARENTS, REDRAWN = 4, 0.3
"""Peaks at which a further wave starts, and the share of coordinates drawn anew."""
CONFIRMED, MOST_WAVES = 4, 4
"""Number of climbs at the highest peak that makes further waves unnecessary, and most waves."""
DIP = 1.0
"""Two climbs are at different peaks if the log density half way falls by this many nats."""
ITERATIONS = 80
"""Most iterations of a climb."""
NEAR = 10.0
"""A peak is kept if its height or its approximation's mass is this close to the largest [nats].
Climbs along a ridge end a few nats apart."""
DIFFERENCE, SMALL, DIFFERENCES = 1e-3, 0.02, (1e-7, 0.03)
"""Differences in u for derivatives: the first one, later ones in standard deviations, and bounds.
Much smaller differences would show the errors of a rough solution. These errors are not a smooth
function of the parameters."""
FACTORS, LENGTHS = np.array([0.03, 1.0, 30.0]), np.array([0.3, 1.0, 3.0])
"""Steps that an iteration tries: factors on the last damping, and multiples of each damped step."""
DAMPINGS = 1e-4, 1e3
"""Bounds of the damping: the multiple of the metric's diagonal that is added to the metric."""
LONGEST = 3.0
"""Longest step in u."""
HUGE = 1e100
"""Largest absolute derivative, so that its square stays finite."""
GAIN, QUIET = 1e-2, 2
"""Smallest gain of an iteration [nats]; a climb ends after so many iterations that gain less."""


@dataclass(frozen=True)
class Points:
    """Points of a density, each with a normal approximation.

    Attributes
    ----------
    z : (K, d).
    factors : (K, d, d), Cholesky factors of the covariances.
    value : (K,), the log density.
    """

    z: FloatArray
    factors: FloatArray
    value: FloatArray

    def at(self, which: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Points:
        """Return the selected points."""
        return Points(self.z[which], self.factors[which], self.value[which])

    @classmethod
    def joined(cls, *parts: Points) -> Points:
        """Join the points of several sets."""
        return cls(
            np.concatenate([part.z for part in parts]),
            np.concatenate([part.factors for part in parts]),
            np.concatenate([part.value for part in parts]),
        )

    @property
    def log_mass(self) -> FloatArray:
        """Log mass of each normal approximation, up to a constant, (K,)."""
        diagonals = np.abs(np.diagonal(self.factors, axis1=1, axis2=2))
        return self.value + np.log(diagonals).sum(axis=1)


def climb(
    target: Target,
    starts: FloatArray,
    factors: FloatArray,
    iterations: int,
    coordinates: Coordinates | None = None,
    quiet: int = QUIET,
) -> Climbs:
    """Maximise by Fisher scoring with Levenberg-Marquardt damping, all climbs in lockstep.

    An iteration calls the density twice for all climbs: for derivatives, as one-sided differences,
    and for steps of several lengths and dampings. (Osborne 1992, International Statistical Review
    60, 99.)

    Parameters
    ----------
    starts : (K, d), in `coordinates`, by default z. Heights are of the density of z.
    factors : (K, d, d); steps are taken in u with x = start + factor u. A factor without full rank
        keeps the climb in the plane of its columns.
    quiet : number of successive iterations with almost no gain after which a climb ends.

    Returns
    -------
    climbs : the climbs at their ends: `x` (K, d), and `value` (K,), the log density of z there.
    """
    climbs = Climbs(target, starts, factors, coordinates or Coordinates(), quiet)
    for _ in range(iterations):
        if not climbs.live.size:
            break
        climbs.advance()
    return climbs


def fisher_factors(
    target: Target,
    x: FloatArray,
    factors: FloatArray,
    coordinates: Coordinates | None = None,
    differences: FloatArray | float = SMALL,
) -> FloatArray:
    """Cholesky factors (K, d, d) of the inverse of the Fisher information, prior included.

    Parameters
    ----------
    x : (K, d), in `coordinates`.
    factors : (K, d, d); their columns are the directions of the differences.
    differences : in units of the columns. A column may be about as long as the density is wide.
    """
    climbs = Climbs(target, x, factors, coordinates or Coordinates())
    climbs.differences[:] = differences
    _, metric = climbs.slope_and_metric(np.arange(len(x)))
    eigenvalues, vectors = np.linalg.eigh(metric)
    eigenvalues = np.maximum(eigenvalues, 1e-12 * eigenvalues[:, -1:])
    return triangular(factors @ (vectors / np.sqrt(eigenvalues)[:, None]))


@dataclass
class Climbs:
    """Positions of K climbs in u, and the size of their differences for derivatives."""

    target: Target
    starts: FloatArray
    factors: FloatArray
    coordinates: Coordinates
    most_quiet: int = QUIET

    def __post_init__(self) -> None:
        count, d = self.starts.shape
        self.u = np.zeros((count, d))
        self.differences = np.full((count, d), DIFFERENCE)
        self.damping = np.full(count, FACTORS[0])
        self.quiet = np.zeros(count, dtype=int)
        self.highest_rest = -np.inf
        self.value = self._at(np.arange(count), self.u[:, None])[2][:, 0]
        self.live = np.flatnonzero(np.isfinite(self.value))

    @property
    def x(self) -> FloatArray:
        """Positions of the climbs in their coordinates, (K, d)."""
        return self.place(np.arange(len(self.starts)), self.u[:, None])[:, 0]

    def place(self, which: NDArray[np.intp], u: FloatArray) -> FloatArray:
        """Return x (K, M, d) for u (K, M, d) of the climbs `which`."""
        steps = np.matmul(u, self.factors[which].transpose(0, 2, 1))
        return np.asarray(self.starts[which][:, None] + steps)

    def _at(self, which: NDArray[np.intp], u: FloatArray) -> tuple[Split, FloatArray, FloatArray]:
        """Return the log-likelihood by points, z (K, M, d) and the log density (K, M).

        The log density is -inf where it is not finite, or where u is outside the prior's support.
        """
        count, many, d = u.shape
        z = self.coordinates.bend(self.place(which, u).reshape(-1, d))
        outside = np.isnan(z[:, 0])
        split = self.target.split(np.where(outside[:, None], 0.0, z))
        value = split.total + self.target.prior * log_standard_normal(z)
        value = np.where(np.isfinite(value), value, -np.inf).reshape(count, many)
        by_climb = Split(*(part.reshape(count, many, *part.shape[1:]) for part in split))
        return by_climb, z.reshape(count, many, d), value

    def advance(self) -> None:
        """Make one iteration of the climbs that have not ended."""
        live = self.live
        dampings = self.damping[live][:, None] * FACTORS
        steps = _damped_steps(*self.slope_and_metric(live), dampings)
        trial = self.u[live][:, None] + steps
        values = self._at(live, trial)[2]
        rows, best = np.arange(live.size), values.argmax(axis=1)
        gain = values[rows, best] - self.value[live]
        better = gain > 0.0
        self.u[live[better]] = trial[rows, best][better]
        self.value[live[better]] = values[rows, best][better]
        self.damping[live] = np.clip(dampings[rows, best % len(FACTORS)], *DAMPINGS)
        self.quiet[live] = np.where(gain > GAIN, 0, self.quiet[live] + 1)
        self.live = live[self.quiet[live] < self.most_quiet]

    def slope_and_metric(self, live: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return gradient (K, d) and Fisher information (K, d, d), both with the prior.

        A normal score e with the log scale c has the information (e' + e c')^2 + 2 c'^2. The term
        `rest`, which belongs to no point, is taken as its highest value minus half a square.
        """
        d, steps = self.u.shape[1], self.differences[live]
        shifts = np.concatenate([np.zeros((1, d)), np.eye(d)]) * steps[:, None]
        split, z, value = self._at(live, self.u[live][:, None] + shifts)
        works = np.isfinite(value[:, 1:])

        def derivatives(values: FloatArray) -> FloatArray:
            shape = (*works.shape, *(1,) * (values.ndim - 2))
            with np.errstate(invalid="ignore"):
                slopes = (values[:, 1:] - values[:, :1]) / steps.reshape(shape)
            return np.where(works.reshape(shape), np.clip(slopes, -HUGE, HUGE), 0.0)

        scores, scales, rest, of_z = map(derivatives, (*split, z))
        self.highest_rest = max(self.highest_rest, float(split.rest[:, 0].max()))
        bowl = np.maximum(1.0, 2.0 * (self.highest_rest - split.rest[:, 0]))
        slope = rest - np.einsum("kip,kp->ki", scores, split.scores[:, 0]) - scales.sum(axis=2)
        slope -= self.target.prior * np.einsum("kij,kj->ki", of_z, z[:, 0])
        means = np.clip(scores + split.scores[:, :1] * scales, -HUGE, HUGE)
        metric = rest[:, :, None] * rest[:, None] / bowl[:, None, None]
        for part, weight in ((means, 1.0), (scales, 2.0), (of_z, self.target.prior)):
            metric += weight * part @ part.transpose(0, 2, 1)
        widths = 1.0 / np.sqrt(np.maximum(np.diagonal(metric, axis1=1, axis2=2), 1e-300))
        self.differences[live] = np.clip(SMALL * widths, *DIFFERENCES)
        return slope, metric


def _damped_steps(slope: FloatArray, metric: FloatArray, dampings: FloatArray) -> FloatArray:
    """Return steps (K, L F, d) of all L lengths and all F dampings (K, F)."""
    d = slope.shape[1]
    diagonal = np.diagonal(metric, axis1=1, axis2=2)
    floor = np.maximum(
        1e-12 * diagonal.max(axis=1, keepdims=True), 1e-300
    )  # for directions out of the plane, where the metric is zero
    added = dampings[:, :, None] * diagonal[:, None] + floor[:, None]
    damped = metric[:, None] + added[..., None] * np.eye(d)
    way = np.linalg.solve(damped, slope[:, None, :, None])[..., 0]
    steps = (LENGTHS[:, None, None] * way[:, None]).reshape(len(slope), -1, d)
    size = np.linalg.norm(steps, axis=2, keepdims=True)
    return np.asarray(steps * np.minimum(1.0, LONGEST / np.maximum(size, 1e-300)))


def triangular(roots: FloatArray) -> FloatArray:
    """Return Cholesky factors of root root' (K, d, d), also if that product is singular."""
    upper = np.linalg.qr(roots.transpose(0, 2, 1), mode="r")
    signs = np.where(np.diagonal(upper, axis1=1, axis2=2) < 0.0, -1.0, 1.0)
    return np.asarray((signs[:, :, None] * upper).transpose(0, 2, 1), dtype=np.float64)


def peaks(
    target: Target, dimension: int, rng: np.random.Generator, similar: FloatArray | None = None
) -> Points:
    """Return the highest peaks found, highest first.

    Parameters
    ----------
    similar : (N, d) draws of a similar posterior, whose peaks are nearby.

    Raises
    ------
    EveryDrawFailed : the density is zero at every start.
    """
    starts = rng.standard_normal((STARTS, dimension))
    if similar is not None:
        near = similar[rng.integers(len(similar), size=NEAR_STARTS)]
        starts = np.concatenate([near, starts[:NEAR_STARTS]])
    ends = _wave(target, starts)
    for _ in range(MOST_WAVES - 1):
        if (ends.value > ends.value[0] - DIP).sum() >= CONFIRMED:
            break
        parents = ends.z[np.arange(STARTS) % min(PARENTS, len(ends.z))]
        redrawn = rng.random(parents.shape) < REDRAWN
        starts = np.where(redrawn, rng.standard_normal(parents.shape), parents)
        ends = Points.joined(ends, _wave(target, starts))
        ends = ends.at(np.argsort(-ends.value))
    top, mass = ends.value.max(), ends.log_mass
    return ends.at((ends.value > top - NEAR) | (mass > mass.max() - NEAR))


def _wave(target: Target, starts: FloatArray) -> Points:
    """Climb from starts (K, d) and return the ends that are kept, highest first."""
    identity = np.tile(np.eye(starts.shape[1]), (len(starts), 1, 1))
    climbs = climb(target, starts, identity, ITERATIONS)
    usable = np.isfinite(climbs.value)
    if not usable.any():
        raise EveryDrawFailed("no draw of the prior has a finite likelihood")
    which = np.flatnonzero(usable)
    z, value = climbs.x[which], climbs.value[which]
    kept = _of_every_peak(target, z, value)
    differences = climbs.differences[which[kept]]
    factors = fisher_factors(target, z[kept], identity[: len(kept)], differences=differences)
    return Points(z[kept], factors, value[kept])


def _of_every_peak(target: Target, z: FloatArray, value: FloatArray) -> NDArray[np.intp]:
    """Choose which ends (K, d) to keep: half the highest ends, then the highest of other peaks.

    Many climbs end at the same peak. Without this choice, they would leave no place for a peak
    that is a little lower.
    """
    order = np.argsort(-value)
    low, high = np.tril_indices(len(z), -1)
    middles = 0.5 * (z[order[low]] + z[order[high]])
    apart = np.zeros((len(z), len(z)), dtype=bool)
    apart[low, high] = ~(target(middles) > value[order[low]] - DIP)
    chosen = list(range(min(KEPT // 2, len(z))))
    for k in range(len(chosen), len(z)):
        if len(chosen) < KEPT and apart[k, chosen].all():
            chosen.append(k)
    rest = [k for k in range(len(z)) if k not in chosen]
    return order[np.sort((chosen + rest)[:KEPT])]
