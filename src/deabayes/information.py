"""What an experiment would tell before it is done: which candidate is right, and its parameters.

y is all that the experiment would read. Each candidate M predicts it by its posterior's draws,

    p(y | M) = E[p(y | theta, M)],    theta ~ p(theta | data, M),

of which p(y | theta, M) is known exactly, samples are easy, and the mean is not: with S draws,
(1/S) sum_s p(y | theta_s) needs some exp(I) of them where y tells I nats about theta.
"""

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


@dataclass(frozen=True)
class CandidateInformation:
    """What y tells about which candidate is right, with Monte Carlo standard errors.

    Attributes
    ----------
    nats : lower bound of the mutual information of M and y, all candidates equally probable;
        at most the logarithm of their number.
    probability_right : of naming the right candidate from y.
    """

    nats: float
    nats_error: float
    probability_right: float
    probability_right_error: float


def candidate_information(
    predictives: Sequence[Predictive], rng: np.random.Generator
) -> CandidateInformation:
    r"""Mutual information of the candidate and an experiment's outcome.

    I(M; y) >= log K + E[log q(M | y)],  q(M | y) = q(y | M) / sum_j q(y | M_j),

    for any q (Barber & Agakov 2003, Advances in Neural Information Processing Systems 16; for
    experiments Foster et al. 2019, arXiv:1903.05480), with y drawn from the candidates' own
    predictives and q their `Predictive`, made from other draws. What q gets wrong loses
    information and never adds any; naming the candidate of the largest q(M | y) likewise is
    at most as often right as by p. No response is an outcome too.
    """
    count = len(predictives)
    terms = [_of_truth(predictives, truth, rng) for truth in range(count)]
    nats, right = (np.array([term[k] for term in terms]) for k in (0, 1))
    errors = np.sqrt(np.sum(np.array([term[2] for term in terms]) ** 2, axis=0)) / count
    return CandidateInformation(
        float(np.log(count) + nats.mean()), float(errors[0]), float(right.mean()), float(errors[1])
    )


def _of_truth(
    predictives: Sequence[Predictive], truth: int, rng: np.random.Generator
) -> tuple[float, float, tuple[float, float]]:
    """Means of log q(M | y) and of being right where one candidate is, with their errors."""
    share = predictives[truth].failed_share
    nats, right = _judged(np.array([[each.log_failed[0]] for each in predictives]), truth)
    if share == 1.0:
        return float(nats[0]), float(right[0]), (0.0, 0.0)
    y = predictives[truth].sample(rng)
    log_q = [_log_response(each, y) for each in predictives]
    seen_nats, seen_right = _judged(np.stack(log_q), truth)
    kept = (1.0 - share) / np.sqrt(len(seen_nats))
    return (
        share * float(nats[0]) + (1.0 - share) * float(seen_nats.mean()),
        share * float(right[0]) + (1.0 - share) * float(seen_right.mean()),
        (kept * float(seen_nats.std()), kept * float(seen_right.std())),
    )


def _log_response(predictive: Predictive, y: Readings) -> FloatArray:
    """log q of outcomes; only a failure is expected where no draw has a response."""
    if not predictive.known:
        return np.full(len(y[0]), -np.inf)
    return predictive.log_failed[1] + predictive.log_density(y)


def _judged(log_q: FloatArray, truth: int) -> tuple[FloatArray, FloatArray]:
    """log q(M | y) of the truth and the share of right answers, for log q(y | M) (K, Y).

    Where candidates are equally probable, one of them is picked at random.
    """
    from scipy.special import logsumexp

    best = log_q >= log_q.max(axis=0) - 1e-12
    right = np.where(best[truth], 1.0 / best.sum(axis=0), 0.0)
    return np.asarray(log_q[truth] - logsumexp(log_q, axis=0)), right


def parameter_information(predictive: Predictive) -> tuple[float, float]:
    r"""Expected information about a candidate's parameters in nats, and its standard error.

    E[1/2 log det(I + C^(-1/2) F F^T C^(-1/2))] over draws of the noise C (Lindley 1956,
    10.1214/aoms/1177728069, for a linear model with normal noise; Chaloner & Verdinelli 1995,
    10.1214/ss/1177009939, eq. 4). Exact for curves linear in the parameters; of all laws with
    the curves' covariance the normal one gives most. Information about the noise is left out.
    """
    values = np.array([each.information for each in predictive.normals])
    return float(values.mean()), float(values.std() / np.sqrt(values.size))
