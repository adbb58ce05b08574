"""Outcomes of an experiment under a candidate, and probability integral transforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.noise.base import NoiseModel

NOISE_DRAWS = 8
"""Number of draws of the noise parameters; a normal predictive is formed for every one of them."""
SLIGHT = 1e-6
"""Size of residuals, relative to the noise, at which normal scores are taken to be linear."""
ENOUGH_DRAWS = 20.0
"""Smallest number of effective draws; `transforms` does not update weights any further below."""
LOG_2PI = float(np.log(2.0 * np.pi))
Readings = tuple[FloatArray, ...]
"""Outcomes of an experiment: one array (Y, N) per record."""


@dataclass(frozen=True)
class Reading:
    """Predictive distribution of one record under one candidate: curves, and noise about them.

    Attributes
    ----------
    curves : (S, N) the model's response to the record, one row per draw. It is the response's
        logarithm if errors are proportional to the response.
    scales : (S,) scale that divides each draw's residuals before the noise model applies.
    noise_draws : noise parameters by name, each (S,).
    along, weights : (N,) coordinate and weights for the noise model.
    """

    curves: FloatArray
    scales: FloatArray
    noise: NoiseModel
    noise_draws: Mapping[str, FloatArray]
    along: FloatArray
    weights: FloatArray

    def of_draws(self, picked: NDArray[np.intp] | slice) -> Reading:
        """Return the distribution with some of the draws only."""
        noise_draws = {name: values[picked] for name, values in self.noise_draws.items()}
        curves, scales = self.curves[picked], self.scales[picked]
        return Reading(curves, scales, self.noise, noise_draws, self.along, self.weights)

    def sample(self, rng: np.random.Generator) -> FloatArray:
        """Sample one outcome y per draw, (S, N)."""
        parts = self.noise.sample(rng, self.along, self.weights, self.noise_draws)
        return self.curves + self.scales[:, None] * (parts[0] + parts[1])

    def log_density(self, y: FloatArray) -> FloatArray:
        """log p(y | theta_s) of one outcome y (N,) for every draw, (S,)."""
        residuals = (y - self.curves) / self.scales[:, None]
        total = self.noise.log_prob(residuals, self.along, self.weights, self.noise_draws)
        return total - y.size * np.log(self.scales)

    def whitened(self, residuals: FloatArray, draw: int) -> tuple[FloatArray, float]:
        """Residuals (R, N) whitened by one draw's noise, and log |det| of the whitening map.

        The map is the slope of the noise's normal scores at zero residuals. This is exact for
        normal noise, and holds for small residuals of other noise.
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
    r"""Normal density N(y; m, C + F F^T).

    C is the noise covariance of one draw, F F^T the covariance of the curves. White residuals
    u = C^(-1/2) (y - m) have the covariance I + G G^T, with G = C^(-1/2) F = U s V^T. The density
    therefore needs only U and s (Woodbury), for any number of points.
    """

    draw: int
    directions: FloatArray
    singular: FloatArray
    log_volume: float

    @classmethod
    def of(cls, readings: Sequence[Reading], draw: int) -> Normal:
        whitened = [r.whitened(r.curves - r.curves.mean(axis=0), draw) for r in readings]
        white = np.concatenate([residuals for residuals, _ in whitened], axis=1)
        count = max(len(white) - 1, 1)
        _, singular, directions = np.linalg.svd(white / np.sqrt(count), full_matrices=False)
        return cls(draw, directions, singular, sum(volume for _, volume in whitened))

    @property
    def information(self) -> float:
        """1/2 log det(I + G G^T), the information of y about theta for known noise, in nats."""
        return 0.5 * float(np.sum(np.log1p(self.singular**2)))

    def log_density(self, readings: Sequence[Reading], y: Readings) -> FloatArray:
        """Log density of Y outcomes, (Y,)."""
        whitened = [
            reading.whitened(outcome - reading.curves.mean(axis=0), self.draw)[0]
            for reading, outcome in zip(readings, y, strict=True)
        ]
        white = np.concatenate(whitened, axis=1)
        shrunk = self.singular**2 / (1.0 + self.singular**2)
        squares = np.sum(white**2, axis=1) - (white @ self.directions.T) ** 2 @ shrunk
        constant = self.log_volume - 0.5 * white.shape[1] * LOG_2PI
        return np.asarray(constant - self.information - 0.5 * squares)


@dataclass(frozen=True)
class Predictive:
    """Predictive p(y | M) of an experiment; density and samples use different draws.

    The density is the mean of two densities. The first is the mean of p(y | theta_s) over draws,
    which is good if y tells little about theta. The second is the mean of `Normal` over noise
    draws, which is good if the curves are linear in theta. Both are normalised, so the log
    density is at most log 2 below the larger of the two.

    Attributes
    ----------
    known, others : the experiment's records, with the draws for the density and for samples.
    failed : (number of draws without a response, number of draws tried).
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
        """Log probabilities of a failure and of a response; both are always finite."""
        share = (self.failed[0] + 0.5) / (self.failed[1] + 1.0)
        return float(np.log(share)), float(np.log1p(-share))

    def sample(self, rng: np.random.Generator) -> Readings:
        """Sample one outcome per draw of `others`."""
        return tuple(reading.sample(rng) for reading in self.others)

    def log_density(self, y: Readings) -> FloatArray:
        """log p(y | M) of Y outcomes, (Y,), given that there is a response."""
        from scipy.special import logsumexp

        by_normal = np.stack([normal.log_density(self.known, y) for normal in self.normals])
        rows = [
            sum(reading.log_density(one) for reading, one in zip(self.known, outcome, strict=True))
            for outcome in zip(*y, strict=True)
        ]
        by_draw = np.stack(rows, axis=1)
        halves = [logsumexp(d, axis=0) - np.log(len(d)) for d in (by_normal, by_draw)]
        return np.asarray(np.logaddexp(*halves) - np.log(2.0))


def transforms(
    scores: FloatArray, log_density: FloatArray | None = None, enough: float = ENOUGH_DRAWS
) -> FloatArray:
    r"""PIT (N,) of a record's points, uniform and independent if model and noise are right.

    .. math:: u_k = \sum_s w_{sk} \Phi(e_{sk}), \quad w_{sk} \propto p(y_1, ..., y_{k-1} | theta_s)

    Here e are the innovations of a draw. p(y_k | y_1..k-1) is a mean over the posterior *given
    the points before k*. For a held-out record, the weights therefore update the draws point by
    point. With equal weights, a right model's error, which is smooth along the record, would
    count again at every point.

    Parameters
    ----------
    scores : (S, N) innovations, standard normal for a right draw; rows with NaN do not count.
    log_density : (S, N) log p(y_k | y_1..k-1, theta_s) of a held-out record. None if the draws
        were fitted to the record; all weights are then equal.
    enough : number of effective draws. From the first point with fewer, the weights stay as they
        are at the point before, since otherwise only a few draws would count.
    """
    from scipy.special import ndtr

    finite = np.all(np.isfinite(scores), axis=1)
    if log_density is not None:
        finite &= np.all(np.isfinite(log_density), axis=1)
    if not finite.any():
        return np.full(scores.shape[1], np.nan)
    by_draw = ndtr(scores[finite])
    if log_density is None:
        return np.asarray(by_draw.mean(axis=0))
    return np.asarray(np.sum(_weights(log_density[finite], enough) * by_draw, axis=0))


def _weights(log_density: FloatArray, enough: float) -> FloatArray:
    """Weights (S, N) of the draws; they sum to 1 at every point, and are equal at the first."""
    before = np.cumsum(log_density, axis=1) - log_density
    weights = np.exp(before - before.max(axis=0))
    weights /= weights.sum(axis=0)
    few = 1.0 / np.sum(weights**2, axis=0) < min(enough, 0.5 * len(weights))
    if few.any():
        first = max(int(np.argmax(few)), 1)
        weights[:, first:] = weights[:, first - 1 : first]
    return weights
