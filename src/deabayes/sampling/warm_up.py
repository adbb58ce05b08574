"""From the prior to populations of the posterior: climb, walk along the ridges, temper.

The peak may be at one end of a long ridge, far from most of the posterior. From it a walk goes
each way along each coordinate: the coordinate is held a little further on, and the others climb.
What it visits is the profile of the density (Venzon and Moolgavkar 1988, Applied Statistics 37,
87), until that has fallen too far. Any ridge changes some coordinate, whose profile follows it.
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
"""The work is at beta = 1: a proposal is as good as the draws it is fitted to are independent."""
FOR_EVIDENCE = replace(SCHEDULE, final_rounds=(3, 3))
"""Where only the log evidence is wanted, which is known before beta = 1 is reached."""
MOST_POINTS, APART = 64, 1.5
"""Of the ridges' points, each with an approximation of its own, and how far apart they are."""
WIDER = 1.2
"""Times the widths of the approximations, for draws that tempering narrows: it widens badly."""
REACH = 7.0
"""Nats below the highest point at which a walk ends."""
MOST_STEPS, ITERATIONS, MOST_FAILURES = 14, 8, 2
"""Of a walk; of each climb; and of steps in turn that leave the ridge."""
FALL, LARGEST_FALL = 2.0, 4.0
"""Nats that a step should go down, and at most."""
SHORTER, LONGEST = 0.35, 8.0
"""Of a step: after one that left the ridge; and in standard deviations."""
FURTHEST = 4.0
"""Standard deviations of the prior."""
NORMAL_FROM, NORMAL = 1.9, 0.15
"""A walk that has gone so many standard deviations, and down by as much as a normal density to
this part, ends: the peak's own approximation says the rest."""
DIFFERENCE = 1e-4
"""Of coordinates, for their derivatives."""


def warm_up(
    problem: Problem,
    target: Target,
    shape: tuple[int, int],
    seed: np.random.SeedSequence,
    progress: Progress,
    similar: FloatArray | None = None,
    schedule: Schedule = SCHEDULE,
) -> Populations:
    """Populations (E, P, d) of the posterior.

    Parameters
    ----------
    shape : E, P.
    similar : (N, d) draws of a similar posterior, from which climbs start too.

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
    """Normal approximations along the ridges through the highest peak, and at other peaks.

    Their weights are equal: tempering weighs them.
    """
    tops = peaks(target, problem.dimension, rng, similar)
    walks = [profiles(target, tops.at(slice(1)))]
    if problem.coordinates.parts:
        walks.append(profiles(target, tops.at(slice(1)), problem.coordinates))
    points = thinned(Points.joined(tops, *walks), MOST_POINTS, APART)
    weights = np.full(len(points.z), 1.0 / len(points.z))
    return Mixture(weights, points.z, WIDER * points.factors)


def profiles(target: Target, peak: Points, coordinates: Coordinates | None = None) -> Points:
    """Points along the profiles through a peak, with the peak itself.

    Parameters
    ----------
    peak : one point.
    coordinates : along which the walks go; z itself when None. Heights are those in z.
    """
    if coordinates is None:
        return _profiles(target, peak, Coordinates())
    u = coordinates.straighten(peak.z)[0]
    factors = np.asarray(np.linalg.solve(_slopes(coordinates, u), peak.factors), dtype=np.float64)
    found = _profiles(target, Points(u, factors, peak.value), coordinates)
    roots = _slopes(coordinates, found.z) @ found.factors
    usable = np.isfinite(roots).all(axis=(1, 2))
    factors = triangular(roots[usable])
    thick = np.asarray((np.diagonal(factors, axis1=1, axis2=2) > 0.0).all(axis=1))
    z = coordinates.bend(found.z[usable])
    return Points(z, factors, found.value[usable]).at(thick)


def _slopes(coordinates: Coordinates, u: FloatArray) -> FloatArray:
    """dz / du at u (K, d): (K, d, d)."""
    count, d = u.shape
    shifts = DIFFERENCE * np.eye(d)
    up, down = ((u[:, None] + side * shifts).reshape(-1, d) for side in (1.0, -1.0))
    slopes = (coordinates.bend(up) - coordinates.bend(down)) / (2.0 * DIFFERENCE)
    return slopes.reshape(count, d, d).transpose(0, 2, 1)


@dataclass(frozen=True)
class _Walks:
    """Where walks are: one each way along each coordinate."""

    column: NDArray[np.intp]
    sign: FloatArray
    here: Points
    length: FloatArray
    failures: NDArray[np.intp]

    def only(self, which: NDArray[np.bool_]) -> _Walks:
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
    found = [peak]
    top = float(peak.value.max())
    for _ in range(MOST_STEPS):
        if not walks.column.size:
            break
        reached, walks = _step(target, walks, top, peak, coordinates)
        if len(reached.z):
            found.append(reached)
            top = max(top, float(reached.value.max()))
    every = Points.joined(*found)
    return every.at(every.value > top - REACH)


def _step(
    target: Target, walks: _Walks, top: float, peak: Points, coordinates: Coordinates
) -> tuple[Points, _Walks]:
    """Take one step of every walk: the points reached, and the walks that go on."""
    ways, planes = _ways_and_planes(walks.here.factors, walks.column)
    starts = walks.here.z + (walks.sign * walks.length)[:, None] * ways
    climbs = climb(target, starts, planes, ITERATIONS, coordinates)
    z, value = climbs.x, climbs.value
    rows = np.arange(len(z))
    held = z[rows, walks.column]
    fall = np.where(np.isfinite(value), walks.here.value - value, np.inf)
    left = (fall > LARGEST_FALL) | (np.abs(held) > FURTHEST)
    ended = ~left & ((value < top - REACH) | _as_normal(held, value, walks.column, peak))
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
    return reached, replace(walks, length=length, failures=failures).only(~ended)


def _as_normal(
    held: FloatArray, value: FloatArray, column: NDArray[np.intp], peak: Points
) -> NDArray[np.bool_]:
    """Which walks have gone down as a normal density with the peak's covariance does."""
    sds = np.linalg.norm(peak.factors[0][column], axis=1)
    expected = 0.5 * ((held - peak.z[0, column]) / sds) ** 2
    far = expected > 0.5 * NORMAL_FROM**2
    return far & (np.abs(peak.value[0] - value - expected) < NORMAL * expected)


def _ways_and_planes(
    factors: FloatArray, column: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """The step (K, d) of one standard deviation of a coordinate, along which the others follow.

    And factors (K, d, d) of the covariance of the others when that coordinate is held. Both are
    columns of factor Q with a reflection Q that leaves nothing of the coordinate but in the first.
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
    """At most so many points, from the highest down, so many standard deviations apart."""
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
