"""Are ranks uniform? The 95 % simultaneous band of their empirical distribution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

FloatArray = NDArray[np.float64]
SIMULATIONS = 4000


@dataclass(frozen=True)
class Band:
    """Limits (K,) of the ECDF at the ranks' possible values, simultaneous at 95 %."""

    points: FloatArray
    lower: FloatArray
    upper: FloatArray


def ecdf(ranks: FloatArray, possible: int) -> FloatArray:
    """Share of ranks at or below 0, 1, ..., possible - 2 (of `possible` values)."""
    return np.searchsorted(np.sort(ranks), np.arange(possible - 1), side="right") / ranks.size


def smallest_tail(counts: FloatArray, size: int, points: FloatArray) -> FloatArray:
    """min over points of the two-sided binomial tail of counts (..., K)."""
    below = binom.cdf(counts, size, points)
    above = binom.sf(counts - 1, size, points)
    return np.min(2.0 * np.minimum(below, above), axis=-1)


@cache
def critical_tail(size: int, possible: int) -> float:
    """The pointwise tail that 95 % of uniform rank samples keep everywhere."""
    rng = np.random.default_rng(7)
    points = np.arange(1, possible) / possible
    ranks = rng.integers(0, possible, (SIMULATIONS, size))
    counts = np.stack([ecdf(r, possible) * size for r in ranks])
    return float(np.quantile(smallest_tail(counts, size, points), 0.05))


def band(size: int, possible: int) -> Band:
    """The band for `size` ranks with `possible` values each (Saeilynoja et al. 2022)."""
    points = np.arange(1, possible) / possible
    tail = critical_tail(size, possible)
    lower = binom.ppf(tail / 2, size, points) / size
    upper = binom.isf(tail / 2, size, points) / size
    return Band(points, lower, upper)


def inside(ranks: FloatArray, possible: int) -> bool:
    """Whether the ranks stay inside the band."""
    points = np.arange(1, possible) / possible
    counts = ecdf(ranks, possible) * ranks.size
    return bool(smallest_tail(counts, ranks.size, points) >= critical_tail(ranks.size, possible))
