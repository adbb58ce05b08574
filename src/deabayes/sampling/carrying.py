"""Particles carried to a peak that none of them saw: found by climbs, entered by tempering."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import expit

from deabayes.experiment import FloatArray
from deabayes.sampling.climb import PROMISING, SHORT, Peak, climb, laplace_factor
from deabayes.sampling.cloud import LogDensity, Schedule
from deabayes.sampling.guide import Guide
from deabayes.sampling.proposal_fit import fit
from deabayes.sampling.smc import Population, anneal

Places = Callable[[FloatArray], FloatArray]
"""z (d,) -> places (K, d) where climbs to other peaks may begin."""

TURNS, NARROW = 3, 0.1
"""Climbs of those that are finished: straight on in such steps, and along what particles spread
over, which is of little use on the way to another peak."""
FEW = 10
"""Places of which every climb is finished: what is far below after a little may lead highest."""
HIGHER = 3.0
"""Nats above the best peak so far. Climbs along a thin ridge end a nat or two apart."""
COMPONENTS = 4
WIDER, WIDEST = 4.0, 1.0
"""Times the Laplace widths, up to that of the prior: tempering narrows easily and widens badly."""


def higher_peak(target: LogDensity, best: Peak, factor: FloatArray, places: Places) -> Peak | None:
    """A peak higher than the best one so far, if climbs from the places about it end at one.

    Where places are many, all are climbed from for a little along the axes, and the climbs of the
    most promising are finished.

    Parameters
    ----------
    factor : Cholesky factor of the particles' covariance (d, d).
    """
    steps = NARROW * np.eye(best.z.size), factor
    begun = list(places(best.z))
    if len(begun) > FEW:
        reached = [climb(target, place, steps[0], SHORT) for place in begun]
        reached.sort(key=lambda reached: -reached[1])
        begun = [z for z, _ in reached[:PROMISING]]
    (_, level), *others = (_finished(target, start, steps) for start in (best.z, *begun))
    z, value = max(others, key=lambda reached: reached[1], default=(best.z, level))
    if value < level + HIGHER:
        return None
    return Peak(z, value, laplace_factor(target, z, factor))


def _finished(
    target: LogDensity, z: FloatArray, steps: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, float]:
    value = -np.inf
    for turn in range(1, TURNS + 1):
        z, value = climb(target, z, steps[turn % 2])
    return z, value


def carried(
    target: LogDensity,
    population: Population,
    peak: Peak,
    rng: np.random.Generator,
    schedule: Schedule,
    guide: Guide,
) -> Population:
    """A population joined by one that is cooled at a higher peak than its own.

    A proposal fitted to its displaced particles is what the tempering begins with: the ridges that
    they have spread along are kept, where draws of the Laplace approximation alone would be on a
    short piece of them.
    """
    moved = displaced(target, population, peak, rng)
    begin = fit(moved, COMPONENTS, rng, coordinates=guide.coordinates)
    there = anneal(
        begin.sample(rng, len(population.particles)),
        begin.log_density,
        lambda z: target(z) - begin.log_density(z),
        rng,
        schedule,
        guide=replace(guide, hops=()),
    )
    return joined(population, there, rng)


def joined(first: Population, second: Population, rng: np.random.Generator) -> Population:
    """As many particles as the first has, of each in proportion to its evidence.

    A peak that is higher may be so thin that next to nothing of the mass is there.
    """
    size = len(first.particles)
    of_second = round(size * float(expit(second.log_evidence - first.log_evidence)))
    here, there = (rng.permutation(size)[:n] for n in (size - of_second, of_second))

    def both(of: Callable[[Population], FloatArray]) -> FloatArray:
        return np.concatenate([of(first)[here], of(second)[there]])

    log_density = both(lambda population: population.log_density)
    return replace(
        second,
        particles=both(lambda population: population.particles),
        broad=both(lambda population: population.broad),
        log_base=log_density,
        log_increment=np.zeros(size),
        log_evidence=float(np.logaddexp(first.log_evidence, second.log_evidence)),
    )


def displaced(
    target: LogDensity, population: Population, peak: Peak, rng: np.random.Generator
) -> FloatArray:
    """Its particles (P, d) moved by the way from where the best of them climbs to the peak.

    They are widened along the axes of the Laplace approximation there, as what was well determined
    may not be any more.
    """
    particles = population.particles
    start, _ = climb(target, particles[np.argmax(population.log_density)], population.factor)
    axes, widths, _ = np.linalg.svd(peak.factor)
    wider = axes * np.minimum(WIDER * widths, np.maximum(widths, WIDEST))
    return particles + (peak.z - start) + rng.standard_normal(particles.shape) @ wider.T
