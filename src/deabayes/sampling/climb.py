"""From particles that tempering left beside a posterior's bulk, onto it.

Records with little noise make a posterior a thin curved sheet. Tempered particles end on
its rim, tens of nats below the bulk, and creep inwards for thousands of steps. Climbing is
quick: peaks are found by quasi-Newton from a few particles, in coordinates whitened by all
of them, and draws of the Laplace approximations there, resampled by importance, start anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.cloud import LogDensity
from deabayes.sampling.mixture import Mixture
from deabayes.sampling.smc import Population

LATE, EARLY, PROMISING = 5, 30, 5
"""Climbs from the end; short ones from the first two thirds of the schedule, where particles
are still everywhere (on NIST's Gauss2 one of twenty finds the best of dozens of peaks); and how
many of these are finished."""
ITERATIONS, SHORT = 300, 60
STEP = 1e-3
CURVATURE_STEP = 0.03
WIDEST_PEAKS = 10.0
"""Nats below the best peak that are still looked at."""
MISSED = 3.0
"""Standard deviations of the log-posterior below its mean on a normal bulk."""


@dataclass(frozen=True)
class Peak:
    """A maximum of the log density, with a Cholesky factor of its Laplace covariance."""

    z: FloatArray
    log_density: float
    factor: FloatArray


def bulk_missed(log_posterior: FloatArray, peak: float, dimension: int) -> bool:
    """Whether particles lie lower than a normal bulk of that peak and dimension would.

    There peak - log_posterior is half a chi-squared of d degrees of freedom, of mean d/2 and
    variance d/2.
    """
    expected = peak - dimension / 2
    return bool(np.median(log_posterior) < expected - MISSED * np.sqrt(dimension / 2))


def find_peaks(target: LogDensity, population: Population, rng: np.random.Generator) -> list[Peak]:
    """Climb from some particles of a population, and of the way to it; the peaks near the best.

    Particles that tempering has gathered at one of several modes all climb that one.
    """
    particles, factor = population.particles, population.factor
    late = [np.argmax(population.log_density), *rng.permutation(len(particles))[: LATE - 1]]
    early = population.early[rng.permutation(len(population.early))[:EARLY]]
    begun = [climb(target, start, factor, SHORT) for start in early]
    begun.sort(key=lambda reached: -reached[1])
    starts = [*particles[late], *(z for z, _ in begun[:PROMISING])]
    found = [climb(target, start, factor) for start in starts]
    best = max(value for _, value in found)
    near = [(z, value) for z, value in found if value > best - WIDEST_PEAKS]
    return [Peak(z, value, laplace_factor(target, z, factor)) for z, value in near]


def draws_of_peaks(
    target: LogDensity, peaks: list[Peak], size: int, rng: np.random.Generator
) -> FloatArray:
    """Draws (size, d), resampled by importance from the peaks' Laplace approximations.

    The peaks themselves are among what is resampled, so that there is always something.
    """
    dimension = peaks[0].z.size
    mixture = Mixture(
        np.full(len(peaks), 1.0 / len(peaks)),
        np.stack([peak.z for peak in peaks]),
        np.stack([peak.factor for peak in peaks]),
    )
    z = np.concatenate([mixture.means, mixture.sample(rng, 4 * size)])
    excess = target(z) - mixture.log_density(z)
    usable = np.isfinite(excess)
    ceiling = np.quantile(excess[usable], max(1.0 - 0.5 * dimension / usable.sum(), 0.5))
    weights = np.where(usable, np.exp(np.minimum(excess, ceiling) - ceiling), 0.0)
    chosen = rng.choice(len(z), size, p=weights / weights.sum())
    return z[chosen]


def climb(
    target: LogDensity, start: FloatArray, factor: FloatArray, iterations: int = ITERATIONS
) -> tuple[FloatArray, float]:
    """Maximise over start + factor u by L-BFGS, gradients by central differences in one batch."""
    from scipy.optimize import minimize

    dimension = start.size
    shifts = np.concatenate([np.zeros((1, dimension)), STEP * np.eye(dimension)])
    shifts = np.concatenate([shifts, -STEP * np.eye(dimension)])

    def objective(u: FloatArray) -> tuple[float, FloatArray]:
        values = target(start + (u + shifts) @ factor.T)
        if not np.isfinite(values[0]):
            return 1e300, np.zeros(dimension)
        with np.errstate(invalid="ignore"):
            gradient = (values[1 : dimension + 1] - values[dimension + 1 :]) / (2 * STEP)
        return -float(values[0]), -np.where(np.isfinite(gradient), gradient, 0.0)

    found = minimize(
        objective, np.zeros(dimension), jac=True, method="L-BFGS-B",
        options={"maxiter": iterations, "maxcor": 30},
    )  # fmt: skip
    return start + factor @ found.x, -float(found.fun)


def laplace_factor(target: LogDensity, peak: FloatArray, factor: FloatArray) -> FloatArray:
    """Cholesky factor of the inverse of minus the Hessian at a peak, made positive.

    In z the prior alone has the curvature 1: a direction of less is one the differences did
    not resolve.
    """
    dimension = peak.size
    scale = _unit_drop_scales(target, peak, factor)
    steps = factor * scale
    pairs = [(i, j) for i in range(dimension) for j in range(i)]
    axes = np.eye(dimension)
    shifts = [np.zeros(dimension), *axes, *-axes]
    shifts += [axes[i] + axes[j] for i, j in pairs] + [-axes[i] - axes[j] for i, j in pairs]
    values = target(peak + np.array(shifts) @ steps.T)
    values = np.where(np.isfinite(values), values, np.nanmin(values[np.isfinite(values)]))
    plus, minus = values[1 : dimension + 1], values[dimension + 1 : 2 * dimension + 1]
    both = values[2 * dimension + 1 :].reshape(2, len(pairs)).sum(axis=0)
    hessian = np.diag(plus + minus - 2 * values[0])
    for (i, j), value in zip(pairs, both, strict=True):
        mixed = (value + 2 * values[0] - plus[i] - minus[i] - plus[j] - minus[j]) / 2
        hessian[i, j] = hessian[j, i] = mixed
    inverse = np.linalg.inv(steps)
    curvature = -inverse.T @ hessian @ inverse
    eigenvalues, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    return _triangular(vectors / np.sqrt(np.maximum(eigenvalues, 1.0)))


def _triangular(root: FloatArray) -> FloatArray:
    """The Cholesky factor of root root', also where that product loses a thin direction."""
    upper = np.linalg.qr(root.T, mode="r")
    signs = np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    return np.asarray((signs[:, None] * upper).T, dtype=np.float64)


def _unit_drop_scales(target: LogDensity, peak: FloatArray, factor: FloatArray) -> FloatArray:
    """How far along each column of `factor` the log density falls by about a half, (d,)."""
    scale = np.full(peak.size, CURVATURE_STEP)
    for _ in range(12):
        moves = factor * scale
        values = target(np.concatenate([peak[None], peak + moves.T, peak - moves.T]))
        drop = values[0] - 0.5 * (values[1 : peak.size + 1] + values[peak.size + 1 :])
        drop = np.where(np.isfinite(drop), drop, np.inf)
        if np.all((drop > 0.1) & (drop < 2.0)):
            break
        scale = scale * np.clip(np.sqrt(0.5 / np.maximum(drop, 1e-3)), 0.1, 5.0)
    return scale
