"""Create populations of the posterior: climb to peaks, walk along the ridges, temper.

The peak may be at one end of a long ridge, far from most of the posterior. Walks start at the peak,
in both directions along every coordinate. A step fixes this coordinate a little further on, and
climbs in the others. A walk visits the profile of the density (Venzon and Moolgavkar 1988, Applied
Statistics 37, 87), until the density has fallen too far. Every ridge changes some coordinate, and
the profile of this coordinate follows the ridge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.mixture import Mixture
from deabayes.sampling.peaks import Points, climb, fisher_factors, peaks, triangular
from deabayes.sampling.problem import Coordinates, Problem, Target
from deabayes.sampling.progress import Progress
from deabayes.sampling.tempering import Populations, Schedule, temper

SCHEDULE = Schedule(effective_share=0.3, rounds=(1, 2), final_rounds=(10, 60), final_forgotten=0.1)
"""Most rounds are at beta = 1: the more independent the draws, the better is their proposal."""
FOR_EVIDENCE = replace(SCHEDULE, final_rounds=(3, 3))
"""Schedule if only the log evidence is wanted, which is known before the moves at beta = 1."""
MOST_POINTS, APART = 64, 1.5
"""Most points on the ridges, each with its own approximation, and least distance between them."""
WIDER = 1.2
"""Factor on the widths of the approximations; tempering narrows draws, but widens them badly."""
REACH = 7.0
"""A walk ends this many nats below the highest point."""
MOST_STEPS, ITERATIONS, MOST_FAILURES = 14, 8, 2
"""Most steps of a walk, iterations of each climb, and successive steps that leave the ridge."""
FALL, LARGEST_FALL = 2.0, 4.0
"""Fall in nats that a step aims at, and the largest fall that is still on the ridge."""
SHORTER, LONGEST = 0.35, 8.0
"""Factor on the step length after leaving the ridge, and longest step in standard deviations."""
FURTHEST = 4.0
"""Largest absolute value of a walk's coordinate, in standard deviations of the prior."""
NORMAL_FROM, NORMAL = 1.9, 0.15
"""A walk ends after so many standard deviations if the density fell as a normal density does.

The two falls may differ by this share. The peak's own approximation then describes the rest."""
DIFFERENCE = 1e-4
"""Difference in u for the derivatives of coordinates."""


def warm_up(
    problem: Problem,
    target: Target,
    shape: tuple[int, int],
    seed: np.random.SeedSequence,
    progress: Progress,
    similar: FloatArray | None = None,
    schedule: Schedule = SCHEDULE,
) -> Populations:
    """Return populations (E, P, d) of the posterior.

    Parameters
    ----------
    shape : E populations and P particles.
    similar : (N, d) draws of a similar posterior, at which some climbs start.

    Raises
    ------
    EveryDrawFailed : no draw of the prior has a finite likelihood.
    """
    first, second = seed.spawn(2)
    rng = np.random.default_rng(first)
    progress.say("warm-up: climbing to peaks")
    base = ridges(target, problem, rng, similar)
    return temper(
        base.sample(rng, shape[0] * shape[1]).reshape(*shape, problem.dimension),
        base.log_density,
        lambda z: target(z) - base.log_density(z),
        second,
        schedule,
        problem.coordinates,
        log_final=target,
        report=lambda beta, rounds: progress.say(f"warm-up: {100 * beta:.0f} %"),
    )


def ridges(
    target: Target, problem: Problem, rng: np.random.Generator, similar: FloatArray | None = None
) -> Mixture:
    """Return a mixture of approximations along ridges through the highest peak, and at other peaks.

    The weights are equal, because tempering corrects them.
    """
    tops = peaks(target, problem.dimension, rng, similar)
    walks = [profiles(target, tops.at(slice(1)))]
    if problem.coordinates.parts:
        walks.append(profiles(target, tops.at(slice(1)), problem.coordinates))
    points = thinned(Points.joined(tops, *walks), MOST_POINTS, APART)
    weights = np.full(len(points.z), 1.0 / len(points.z))
    return Mixture(weights, points.z, WIDER * points.factors)


def profiles(target: Target, peak: Points, coordinates: Coordinates | None = None) -> Points:
    """Return points along the profiles through a peak, and the peak itself.

    Parameters
    ----------
    peak : one point.
    coordinates : coordinates along which the walks go, z if None. Heights are of the density of z.
    """
    if coordinates is None:
        return _profiles(target, peak, Coordinates())
    u = coordinates.straighten(peak.z)[0]
    factors = np.asarray(np.linalg.solve(_slopes(coordinates, u), peak.factors), dtype=np.float64)
    points = _profiles(target, Points(u, factors, peak.value), coordinates)
    roots = _slopes(coordinates, points.z) @ points.factors
    usable = np.isfinite(roots).all(axis=(1, 2))
    factors = triangular(roots[usable])
    thick = np.asarray((np.diagonal(factors, axis1=1, axis2=2) > 0.0).all(axis=1))
    z = coordinates.bend(points.z[usable])
    return Points(z, factors, points.value[usable]).at(thick)


def _slopes(coordinates: Coordinates, u: FloatArray) -> FloatArray:
    """Return the derivatives dz / du (K, d, d) at u (K, d)."""
    count, d = u.shape
    shifts = DIFFERENCE * np.eye(d)
    up, down = ((u[:, None] + side * shifts).reshape(-1, d) for side in (1.0, -1.0))
    slopes = (coordinates.bend(up) - coordinates.bend(down)) / (2.0 * DIFFERENCE)
    return slopes.reshape(count, d, d).transpose(0, 2, 1)


@dataclass(frozen=True)
class _Walks:
    """State of the walks, one in each direction along each coordinate."""

    column: NDArray[np.intp]
    sign: FloatArray
    here: Points
    length: FloatArray
    failures: NDArray[np.intp]

    def at(self, which: NDArray[np.bool_]) -> _Walks:
        return _Walks(
            self.column[which],
            self.sign[which],
            self.here.at(which),
            self.length[which],
            self.failures[which],
        )


def _profiles(target: Target, peak: Points, coordinates: Coordinates) -> Points:
    d = peak.z.shape[1]
    column, sign = np.tile(np.arange(d), 2), np.repeat([-1.0, 1.0], d)
    none = np.zeros(2 * d, dtype=np.intp)
    walks = _Walks(column, sign, peak.at(none), np.ones(2 * d), none)
    points = [peak]
    top = float(peak.value.max())
    for _ in range(MOST_STEPS):
        if not walks.column.size:
            break
        reached, walks = _step(target, walks, top, peak, coordinates)
        if len(reached.z):
            points.append(reached)
            top = max(top, float(reached.value.max()))
    joined = Points.joined(*points)
    return joined.at(joined.value > top - REACH)


def _step(
    target: Target, walks: _Walks, top: float, peak: Points, coordinates: Coordinates
) -> tuple[Points, _Walks]:
    """Take one step of every walk; return the points reached, and the walks that continue."""
    ways, planes = _ways_and_planes(walks.here.factors, walks.column)
    starts = walks.here.z + (walks.sign * walks.length)[:, None] * ways
    climbs = climb(target, starts, planes, ITERATIONS, coordinates)
    z, value = climbs.x, climbs.value
    rows = np.arange(len(z))
    position = z[rows, walks.column]
    fall = np.where(np.isfinite(value), walks.here.value - value, np.inf)
    left = (fall > LARGEST_FALL) | (np.abs(position) > FURTHEST)
    ended = ~left & ((value < top - REACH) | _as_normal(position, value, walks.column, peak))
    ended |= left & (walks.failures >= MOST_FAILURES)
    on = ~left & ~ended
    factors = planes[on]
    if on.any():
        factors = fisher_factors(target, z[on], walks.here.factors[on], coordinates)
    reached = Points(z[on], factors, value[on])
    walks.here.z[on], walks.here.factors[on] = reached.z, reached.factors
    walks.here.value[on] = reached.value
    growth = np.clip(FALL / np.maximum(np.abs(fall), 0.5), 0.5, 2.0)
    length = np.clip(np.where(left, SHORTER, growth) * walks.length, 0.1, LONGEST)
    failures = np.where(left, walks.failures + 1, 0)
    return reached, replace(walks, length=length, failures=failures).at(~ended)


def _as_normal(
    position: FloatArray, value: FloatArray, column: NDArray[np.intp], peak: Points
) -> NDArray[np.bool_]:
    """Return which walks fell as a normal density with the peak's covariance does."""
    sds = np.linalg.norm(peak.factors[0][column], axis=1)
    expected = 0.5 * ((position - peak.z[0, column]) / sds) ** 2
    far = expected > 0.5 * NORMAL_FROM**2
    return far & (np.abs(peak.value[0] - value - expected) < NORMAL * expected)


def _ways_and_planes(
    factors: FloatArray, column: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return the step (K, d) of one standard deviation of a coordinate, and factors of the others.

    The other coordinates follow the step. The factors (K, d, d) are of their covariance when the
    coordinate is constant. Both results are columns of factor Q. The reflection Q is chosen so that
    only the first column changes the coordinate.
    """
    count, d = column.size, factors.shape[1]
    row = factors[np.arange(count), column]
    size = np.linalg.norm(row, axis=1, keepdims=True)
    normal = row / size
    normal[:, 0] -= 1.0
    square = np.maximum((normal**2).sum(axis=1), 1e-300)[:, None, None]
    reflection = np.eye(d) - 2.0 * normal[:, :, None] * normal[:, None] / square
    planes = factors @ reflection
    planes[np.arange(count), column, 1:] = 0.0
    ways = planes[:, :, 0].copy()
    planes[:, :, 0] = 0.0
    return ways, planes


def thinned(points: Points, most: int, apart: float) -> Points:
    """Select at most `most` points, highest first, at least `apart` standard deviations apart."""
    order = np.argsort(-points.value)
    inverse = np.linalg.inv(points.factors)
    chosen: list[int] = []
    for k in order:
        if chosen:
            steps = points.z[k] - points.z[chosen]
            distance = np.linalg.norm(np.einsum("kij,kj->ki", inverse[chosen], steps), axis=1)
            if distance.min() < apart:
                continue
        chosen.append(int(k))
        if len(chosen) == most:
            break
    return points.at(np.array(chosen))
