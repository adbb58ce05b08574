"""Bands of a posterior's predictions: quantiles of the mixture of its draws' laws of one reading.

A draw's reading is its curve plus noise of a known law, so that the mixture over draws has a known
distribution function. One sample of noise per draw would leave its own error in every point's
quantile: a predictive band inside that of the discrepancy, and jagged edges.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import NoiseModel
from deabayes.residual_scale import ResidualScale
from deabayes.systems.base import Draws

LEVELS = (0.5, 0.9)
TAILS = tuple((0.5 - level / 2, 0.5 + level / 2) for level in LEVELS)
BANDS = ("parameter", "discrepancy", "predictive")
AT_ONCE = 2**17
"""Draws times points of one piece, which a processor's cache holds."""
NEAR = 1e-8
"""By how many standard scores a quantile's share may differ from the one asked."""
TRIES = 100
Cumulative = Callable[[FloatArray], FloatArray]


def bands(
    mean: FloatArray,
    scale: ResidualScale,
    noise: NoiseModel,
    noise_draws: Draws,
    weights: FloatArray,
) -> dict[str, FloatArray]:
    """Equal-tailed intervals (level, bound, N) of the model alone, with discrepancy, with noise.

    Of each point by itself, not given any reading. None ends inside the one before it: with few
    draws beside little noise, quantiles are known to the distance of two draws only.

    Parameters
    ----------
    mean : (S, N) the draws' curves.
    noise_draws : the noise's parameters, each (S,).
    weights : (N,) as the noise model takes them.
    """
    shape = (len(LEVELS), 2, mean.shape[1])
    found = {name: np.empty(shape) for name in BANDS}
    size = max(AT_ONCE // len(mean), 1)
    for first in range(0, mean.shape[1], size):
        part = slice(first, first + size)
        curves, level = mean[:, part], scale.level(mean[:, part])
        spreads = noise.spreads(noise_draws, weights[part])
        inner = np.stack([np.quantile(curves, pair, axis=0) for pair in TAILS])
        found["parameter"][..., part] = inner
        for name, spread in zip(BANDS[1:], spreads, strict=True):
            if np.any(spread):
                wider = _band(level, scale.in_levels(spread), noise, noise_draws, scale)
                inner = _around(inner, wider)
            found[name][..., part] = inner
    return found


def _around(inner: FloatArray, outer: FloatArray) -> FloatArray:
    """Intervals (level, bound, N) that reach as far as either."""
    ends = np.minimum(inner[:, 0], outer[:, 0]), np.maximum(inner[:, 1], outer[:, 1])
    return np.stack(ends, axis=1)


def _band(
    level: FloatArray,
    spread: FloatArray,
    noise: NoiseModel,
    noise_draws: Draws,
    scale: ResidualScale,
) -> FloatArray:
    """The intervals of some points, (level, bound, N)."""

    def cumulative(scores: FloatArray) -> FloatArray:
        return noise.cumulative(scores, noise_draws)

    ends = [[mixture_quantile(level, spread, p, cumulative) for p in pair] for pair in TAILS]
    return scale.response(np.array(ends))


def mixture_quantile(
    location: FloatArray, spread: FloatArray, share: float, cumulative: Cumulative
) -> FloatArray:
    """x (N,) below which lies a `share` of equal parts location + spread times a standard law.

    Secants of the share's normal score, which is straight in x for a normal mixture; the interval
    that x is known to lie in is halved at every third try and where a secant leaves it.

    Parameters
    ----------
    location : (S, N).
    spread : (S, N) or (S, 1); NaN where it is not known, as x then is.
    cumulative : distribution function of the standard law, of (S, n) values.
    """
    from scipy.special import ndtri

    asked, spread = float(ndtri(share)), np.broadcast_to(spread, location.shape)
    unit = np.sqrt(location.var(axis=0) + np.mean(spread**2, axis=0))
    x = location.mean(axis=0) + asked * unit
    search = _Search(x, 1.0 / np.maximum(unit, np.finfo(float).tiny))
    for attempt in range(TRIES):
        points = search.open
        if not points.size:
            break
        below = _below(x[points], location[:, points], spread[:, points], cumulative)
        search.move(ndtri(below) - asked, halve=attempt % 3 == 2)
    return x


def _below(
    x: FloatArray, location: FloatArray, spread: FloatArray, cumulative: Cumulative
) -> FloatArray:
    """The share of the mixture below x (n,), never 0 or 1."""
    with np.errstate(over="ignore"):
        scores = (x - location) / np.maximum(spread, np.finfo(float).tiny)
    return np.clip(cumulative(scores).mean(axis=0), 1e-15, 1.0 - 1e-15)


class _Search:
    """Zeros of increasing functions, one per point; `x` is moved in place.

    Attributes
    ----------
    open : points whose zero is not found yet.
    """

    def __init__(self, x: FloatArray, slope: FloatArray) -> None:
        self.x, self.usual, self.slope = x, slope, slope.copy()
        self.low, self.high = np.full(x.size, -np.inf), np.full(x.size, np.inf)
        self.before = np.full((2, x.size), np.nan)
        self.open = np.flatnonzero(np.isfinite(x))

    def move(self, values: FloatArray, halve: bool) -> None:
        """To where the functions, now with `values` at the open points, are expected to be zero."""
        points = self.open
        x = self.x[points]
        self.low[points] = np.where(values < 0.0, x, self.low[points])
        self.high[points] = np.where(values > 0.0, x, self.high[points])
        with np.errstate(all="ignore"):
            slope = (values - self.before[1, points]) / (x - self.before[0, points])
        fair = np.isfinite(slope) & (slope > 0.0)
        self.slope[points] = np.where(fair, slope, self.usual[points])
        self.before[:, points] = x, values
        low, high = self.low[points], self.high[points]
        width = (high - low) * self.usual[points]
        left = (np.abs(values) > NEAR) & (width > NEAR)
        to = x - values / self.slope[points]
        with np.errstate(invalid="ignore"):
            middle = 0.5 * (low + high)
        out = np.isfinite(middle) & (halve | (to <= low) | (to >= high))
        self.x[points] = np.where(left, np.where(out, middle, to), x)
        self.open = points[left]
