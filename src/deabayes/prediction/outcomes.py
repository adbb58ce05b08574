"""What an experiment may read under a candidate, and probability integral transforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.noise.base import NoiseModel

NOISE_DRAWS = 8
"""Draws of the noise's parameters about which a normal predictive is formed."""
SLIGHT = 1e-6
"""Of the noise: where its normal scores are taken to be straight."""
LOG_2PI = float(np.log(2.0 * np.pi))
Readings = tuple[FloatArray, ...]
"""One array (Y, N) per record of an experiment."""


@dataclass(frozen=True)
class Reading:
    """What one record may read under one candidate: its curves and the law of noise about them.

    Attributes
    ----------
    curves : (S, N) the model's response to the record, one row per draw; its logarithm where
        errors are in proportion to it.
    scales : (S,) what each draw's residuals are divided by before the noise's law.
    noise_draws : the noise's parameters, each (S,).
    along, weights : (N,) as the noise model takes them.
    """

    curves: FloatArray
    scales: FloatArray
    noise: NoiseModel
    noise_draws: Mapping[str, FloatArray]
    along: FloatArray
    weights: FloatArray

    def of_draws(self, picked: NDArray[np.intp] | slice) -> Reading:
        """The same with some of the draws only."""
        noise_draws = {name: values[picked] for name, values in self.noise_draws.items()}
        curves, scales = self.curves[picked], self.scales[picked]
        return Reading(curves, scales, self.noise, noise_draws, self.along, self.weights)

    def sample(self, rng: np.random.Generator) -> FloatArray:
        """One y of every draw, (S, N)."""
        parts = self.noise.sample(rng, self.along, self.weights, self.noise_draws)
        return self.curves + self.scales[:, None] * (parts[0] + parts[1])

    def log_density(self, y: FloatArray) -> FloatArray:
        """log p(y | theta_s) of one y (N,), (S,)."""
        residuals = (y - self.curves) / self.scales[:, None]
        total = self.noise.log_prob(residuals, self.along, self.weights, self.noise_draws)
        return total - y.size * np.log(self.scales)

    def whitened(self, residuals: FloatArray, draw: int) -> tuple[FloatArray, float]:
        """Residuals (R, N) made white by one draw's noise, and log |det| of the map.

        The map is the slope, at zero, of the noise's normal scores: all of it for a normal law,
        the middle of another one.
        """
        noise_draws = {n: np.full(len(residuals), v[draw]) for n, v in self.noise_draws.items()}
        one = {name: values[:1] for name, values in noise_draws.items()}
        scaled = SLIGHT / self.scales[draw] * residuals
        scores = self.noise.innovations(scaled, self.along, self.weights, noise_draws) / SLIGHT
        size = residuals.shape[1]
        at_zero = self.noise.log_prob(np.zeros((1, size)), self.along, self.weights, one)
        log_volume = float(at_zero[0]) + size * (0.5 * LOG_2PI - np.log(self.scales[draw]))
        return scores, float(log_volume)


@dataclass(frozen=True)
class Normal:
    r"""N(y; m, C + F F^T) with C the noise of one draw and F F^T the covariance of the curves.

    White residuals u = C^(-1/2) (y - m) have covariance I + G G^T, G = C^(-1/2) F = U s V^T, so
    that the density needs U and s alone (Woodbury), whatever the number of points.
    """

    draw: int
    directions: FloatArray
    singular: FloatArray
    log_volume: float

    @classmethod
    def of(cls, readings: Sequence[Reading], draw: int) -> Normal:
        found = [r.whitened(r.curves - r.curves.mean(axis=0), draw) for r in readings]
        white = np.concatenate([white for white, _ in found], axis=1)
        count = max(len(white) - 1, 1)
        _, singular, directions = np.linalg.svd(white / np.sqrt(count), full_matrices=False)
        return cls(draw, directions, singular, sum(volume for _, volume in found))

    @property
    def information(self) -> float:
        """1/2 log det(I + G G^T): what y tells about theta if the noise is known, in nats."""
        return 0.5 * float(np.sum(np.log1p(self.singular**2)))

    def log_density(self, readings: Sequence[Reading], y: Readings) -> FloatArray:
        """log density of Y outcomes, (Y,)."""
        pairs = zip(readings, y, strict=True)
        found = [r.whitened(each - r.curves.mean(axis=0), self.draw)[0] for r, each in pairs]
        white = np.concatenate(found, axis=1)
        shrunk = self.singular**2 / (1.0 + self.singular**2)
        squares = np.sum(white**2, axis=1) - (white @ self.directions.T) ** 2 @ shrunk
        constant = self.log_volume - 0.5 * white.shape[1] * LOG_2PI
        return np.asarray(constant - self.information - 0.5 * squares)


@dataclass(frozen=True)
class Predictive:
    """p(y | M) of an experiment, as density from one part of the draws, as samples from another.

    The density is half the mean of p(y | theta_s) over draws, which is right where y tells little
    about theta, and half a mean of `Normal` over noise draws, right where curves are linear in
    theta. Both halves are normalised, so the whole is within log 2 of the better one.

    Attributes
    ----------
    known, others : the experiment's records, with the draws for the density and for samples.
    failed : (draws without a response, draws tried).
    """

    known: tuple[Reading, ...]
    others: tuple[Reading, ...]
    failed: tuple[int, int] = (0, 1)

    @cached_property
    def normals(self) -> tuple[Normal, ...]:
        size = len(self.known[0].curves)
        picked = np.unique(np.linspace(0, size - 1, NOISE_DRAWS).astype(int))
        return tuple(Normal.of(self.known, int(draw)) for draw in picked)

    @property
    def failed_share(self) -> float:
        return self.failed[0] / self.failed[1]

    @property
    def log_failed(self) -> tuple[float, float]:
        """log probabilities of a failure and of a response; neither is ever held impossible."""
        share = (self.failed[0] + 0.5) / (self.failed[1] + 1.0)
        return float(np.log(share)), float(np.log1p(-share))

    def sample(self, rng: np.random.Generator) -> Readings:
        """One outcome per draw kept for it."""
        return tuple(reading.sample(rng) for reading in self.others)

    def log_density(self, y: Readings) -> FloatArray:
        """log p(y | M) of Y outcomes with a response, (Y,)."""
        from scipy.special import logsumexp

        normal = np.stack([each.log_density(self.known, y) for each in self.normals])
        rows = [
            sum(r.log_density(each) for r, each in zip(self.known, row, strict=True))
            for row in zip(*y, strict=True)
        ]
        by_draw = np.stack(rows, axis=1)
        halves = [logsumexp(each, axis=0) - np.log(len(each)) for each in (normal, by_draw)]
        return np.asarray(np.logaddexp(*halves) - np.log(2.0))


ENOUGH_DRAWS = 20.0
"""Effective draws below which weights stay as they are."""


def transforms(
    scores: FloatArray, log_density: FloatArray | None = None, enough: float = ENOUGH_DRAWS
) -> FloatArray:
    r"""PIT (N,) of points, uniform and independent if model and noise hold.

    .. math:: u_k = \sum_s w_{sk} \Phi(e_{sk}), \quad w_{sk} \propto p(y_1, ..., y_{k-1} | theta_s)

    where e are a draw's innovations: p(y_k | y_1..k-1) is a mean over the posterior *given those
    points*, so a record that the fit has not seen is learned from point by point. With equal
    weights a right model's error, smooth along a record, would count at each point anew.

    Parameters
    ----------
    scores : (S, N) innovations, standard normal for a right draw; rows with NaN do not count.
    log_density : (S, N) log p(y_k | y_1..k-1, theta_s) of a held-out record; None where the
        draws have seen the record: equal weights.
    enough : effective draws; from the first point with fewer weights stay what they were, as a
        few draws would be all that is left.
    """
    from scipy.special import ndtr

    finite = np.all(np.isfinite(scores), axis=1)
    if log_density is not None:
        finite &= np.all(np.isfinite(log_density), axis=1)
    if not finite.any():
        return np.full(scores.shape[1], np.nan)
    each = ndtr(scores[finite])
    if log_density is None:
        return np.asarray(each.mean(axis=0))
    return np.asarray(np.sum(_weights(log_density[finite], enough) * each, axis=0))


def _weights(log_density: FloatArray, enough: float) -> FloatArray:
    """(S, N), each point's sum is 1; the first point's are equal."""
    before = np.cumsum(log_density, axis=1) - log_density
    weights = np.exp(before - before.max(axis=0))
    weights /= weights.sum(axis=0)
    few = 1.0 / np.sum(weights**2, axis=0) < min(enough, 0.5 * len(weights))
    if few.any():
        first = max(int(np.argmax(few)), 1)
        weights[:, first:] = weights[:, first - 1 : first]
    return weights
