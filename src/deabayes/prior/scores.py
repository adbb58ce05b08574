"""Normal probabilities and their inverses, accurate in both tails and free of warnings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray

SMALLEST_PROBABILITY = 1e-300
UNRESOLVED_PROBABILITY, UNRESOLVED_SCORE = 2.0**-54, 8.29
"""Tail probability and score of a value that rounding has put on a bound or on its neighbour."""
LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


def log_or_nan(x: ArrayLike) -> FloatArray:
    """log x, NaN where x <= 0."""
    x = np.asarray(x, dtype=float)
    return np.log(np.where(x > 0.0, x, np.nan))


def log_normal_density(z: FloatArray) -> FloatArray:
    """log of exp(-z^2 / 2) / sqrt(2 pi)."""
    return -0.5 * z * z - LOG_SQRT_2PI


def between(lower: float, upper: float, z: ArrayLike) -> FloatArray:
    """lower + (upper - lower) Phi(z), measured from the nearer end."""
    from scipy.special import ndtr

    z = np.asarray(z, dtype=float)
    part = (upper - lower) * ndtr(-np.abs(z))
    return np.where(z < 0.0, lower + part, upper - part)


def score_between(lower: float, upper: float, x: FloatArray, slack: float = 0.0) -> FloatArray:
    """Inverse of `between`; NaN for x outside by more than `slack`, relative to the width."""
    below = (x - lower) / (upper - lower)
    above = (upper - x) / (upper - lower)
    inside = (below >= -slack) & (above >= -slack)
    return np.where(inside, score(np.abs(below), np.abs(above)), np.nan)


def score(below: FloatArray, above: FloatArray) -> FloatArray:
    """Phi^-1(below), with above = 1 - below; computed from the smaller of the two."""
    from scipy.special import ndtri

    smaller = np.minimum(below, above)
    tail = ndtri(np.clip(np.where(smaller <= 0.0, UNRESOLVED_PROBABILITY, smaller), 0.0, 0.5))
    return np.where(below < above, tail, -tail)


def log_normal_mass(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """log(Phi(b) - Phi(a)) for a <= b; -inf for no mass."""
    from scipy.special import log_ndtr

    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    reflect = a > 0.0
    low, high = np.where(reflect, -b, a), np.where(reflect, -a, b)
    log_high, log_low = log_ndtr(high), log_ndtr(low)
    with np.errstate(divide="ignore", invalid="ignore"):
        tails = log_high + np.log(-np.expm1(log_low - log_high))
        across = np.log1p(-np.exp(log_low) - np.exp(log_ndtr(-high)))
    mass = np.where((low < 0.0) & (high > 0.0), across, tails)
    return np.where(a < b, mass, -np.inf)
