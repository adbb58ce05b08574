"""From the prior to populations of the posterior: climb, walk along the ridges, temper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.climbs import Points
from deabayes.sampling.mixture import Mixture
from deabayes.sampling.peaks import peaks
from deabayes.sampling.problem import Problem, Target
from deabayes.sampling.profiles import profiles, thinned
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
