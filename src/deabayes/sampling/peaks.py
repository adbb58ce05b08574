"""The peaks of a posterior, climbed to from draws of the prior, many at once.

Records with little noise make a posterior a thin curved sheet in which tempered particles get
lost, tens of nats below the bulk. Climbs are quick.

Where few climbs have come to the highest peak, further waves of climbs start at the best ones with
some of their coordinates drawn anew: of parts that fit well, such as two units of three, these keep
some.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.climbs import Points, climb, fisher_factors
from deabayes.sampling.problem import Target
from deabayes.sampling.tempering import EveryDrawFailed

STARTS, KEPT = 64, 16
"""Of a wave: starts, and how many of the ends of these climbs are told on."""
NEAR_STARTS = 16
"""Where there is a similar posterior: from draws of it, and as many from the prior."""
PARENTS, REDRAWN = 4, 0.3
"""Peaks that a further wave starts at, and the share of coordinates drawn anew."""
CONFIRMED, MOST_WAVES = 4, 4
"""Climbs that have come to the highest peak when no further wave is made; and most waves."""
DIP = 1.0
"""Nats that the density falls by half way between climbs that are at different peaks."""
ITERATIONS = 80
"""Of a climb, at most."""
NEAR = 10.0
"""Nats that a peak, or the mass of its approximation, may be below the largest to be kept.
Climbs along a ridge end a few apart."""


def peaks(
    target: Target, dimension: int, rng: np.random.Generator, similar: FloatArray | None = None
) -> Points:
    """The highest peaks found, from the highest one down.

    Parameters
    ----------
    similar : (N, d) draws of a similar posterior, whose peaks are near.

    Raises
    ------
    EveryDrawFailed : the density is zero at every start.
    """
    starts = rng.standard_normal((STARTS, dimension))
    if similar is not None:
        near = similar[rng.integers(len(similar), size=NEAR_STARTS)]
        starts = np.concatenate([near, starts[:NEAR_STARTS]])
    found = _wave(target, starts)
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


def _wave(target: Target, starts: FloatArray) -> Points:
    """Ends of climbs from starts (K, d), from the highest one down."""
    every = np.tile(np.eye(starts.shape[1]), (len(starts), 1, 1))
    climbs = climb(target, starts, every, ITERATIONS)
    usable = np.isfinite(climbs.value)
    if not usable.any():
        raise EveryDrawFailed("no draw of the prior has a finite likelihood")
    which = np.flatnonzero(usable)
    z, value = climbs.x[which], climbs.value[which]
    kept = _of_every_peak(target, z, value)
    differences = climbs.differences[which[kept]]
    factors = fisher_factors(target, z[kept], every[: len(kept)], differences=differences)
    return Points(z[kept], factors, value[kept])


def _of_every_peak(target: Target, z: FloatArray, value: FloatArray) -> NDArray[np.intp]:
    """Ends (K, d) to keep: half of them the highest, the others the highest of other peaks.

    Many climbs end at one peak, and would leave no place for another that is a little lower.
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
