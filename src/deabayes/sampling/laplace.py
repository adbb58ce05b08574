"""The highest peak of a posterior and the normal density of its curvature (Laplace's method).

It takes seconds where sampling takes minutes. It is right if the posterior has one peak, and is
nearly normal in the coordinates in which its ridges are straight. `Laplace` holds what shows how
far this is so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.peaks import DIP, ITERATIONS, climb, fisher_factors
from deabayes.sampling.problem import Coordinates, EveryDrawFailed, Problem, Target

STARTS = 16
"""Climbs from draws of the prior; the sampler's warm-up makes four times as many, or more."""
POLISHED = 20
"""Most iterations of the highest climb's continuation with the accurate solver."""
FIRST_STEP, SECOND_STEP = 1e-3, 0.02
"""Differences for the Fisher information: in coordinates, then in standard deviations."""
STEP = 0.25
"""Differences for second derivatives, in standard deviations of the Fisher information."""


@dataclass(frozen=True)
class Laplace:
    """The highest peak found, draws of its normal approximation, and how far to trust them.

    Attributes
    ----------
    peak : z (d,) of the highest peak.
    value : log posterior density of z there.
    draws : (S, d), draws of z from the normal density of the curvature.
    climbs, agreed : number of climbs, and how many of them ended within `DIP` of the peak.
    next_lower : nats from the peak to the best of the other climbs' ends; None without others.
    not_curved : number of directions in which the curvature is not that of a peak. The draws are
        then as wide there as the Fisher information says.
    effective : effective share of the draws, 1 for a normal posterior: with the weights
        w = posterior / normal density, (sum w)^2 / (S sum w^2).
    """

    peak: FloatArray
    value: float
    draws: FloatArray
    climbs: int
    agreed: int
    next_lower: float | None
    not_curved: int
    effective: float


def laplace(problem: Problem, rng: np.random.Generator, size: int) -> Laplace:
    """Climb from draws of the prior, and approximate the posterior at the highest peak.

    Parameters
    ----------
    size : number of draws from the normal density. Draws outside the prior's support are dropped.

    Raises
    ------
    EveryDrawFailed : no start has a finite likelihood.
    """
    quick, d = problem.rough or problem, problem.dimension
    starts, identity = rng.standard_normal((STARTS, d)), np.eye(d)
    target = Target(quick.log_likelihood, quick.split)
    climbs = climb(target, starts, np.tile(identity, (STARTS, 1, 1)), ITERATIONS)
    values = np.sort(climbs.value[np.isfinite(climbs.value)])[::-1]
    if not values.size:
        raise EveryDrawFailed("no draw of the prior has a finite likelihood")
    target = Target(problem.log_likelihood, problem.split)
    best = climb(target, climbs.x[[climbs.value.argmax()]], identity[None], POLISHED)
    agreed = int((values > values[0] - DIP).sum())
    normal = _Normal.at(target, best.x, problem.coordinates)
    draws, effective = normal.sample(rng, size)
    return Laplace(
        best.x[0],
        float(best.value[0]),
        draws,
        STARTS,
        agreed,
        float(values[0] - values[agreed]) if agreed < values.size else None,
        normal.not_curved,
        effective,
    )


@dataclass(frozen=True)
class _Normal:
    """A normal density of u = straighten(z) about a peak, with the Cholesky-like root (d, d)."""

    target: Target
    coordinates: Coordinates
    peak: FloatArray
    root: FloatArray
    not_curved: int

    @classmethod
    def at(cls, target: Target, z: FloatArray, coordinates: Coordinates) -> _Normal:
        """Approximate the density at the peak z (1, d) by its curvature in u."""
        u = coordinates.straighten(z)[0]
        factor = np.eye(u.shape[1])[None]
        for step in (FIRST_STEP, SECOND_STEP):
            factor = fisher_factors(target, u, factor, coordinates, step)
        density = cls(target, coordinates, u[0], factor[0], 0)
        curvature, failed = _curvature(density, STEP)
        eigenvalues, vectors = np.linalg.eigh(curvature)
        flat = eigenvalues <= 0.0
        root = factor[0] @ (vectors / np.sqrt(np.where(flat, 1.0, eigenvalues)))
        return cls(target, coordinates, u[0], root, failed + int(flat.sum()))

    def log_posterior(self, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return z (W, d) at the peak plus root times steps, and the log density of u there.

        The density is -inf where the model fails, or outside the prior's support.
        """
        z = self.coordinates.bend(self.peak + steps @ self.root.T)
        outside = np.isnan(z[:, :1])
        inside = np.where(outside, 0.0, z)
        value = self.target(inside) - self.coordinates.straighten(inside)[1]
        return z, np.where(outside[:, 0] | ~np.isfinite(value), -np.inf, value)

    def sample(self, rng: np.random.Generator, size: int) -> tuple[FloatArray, float]:
        """Return draws of z, and their effective share (see `Laplace`)."""
        steps = rng.standard_normal((size, self.peak.size))
        z, value = self.log_posterior(steps)
        if not np.isfinite(value).any():
            return z[:0], 0.0
        log_weights = value + 0.5 * np.einsum("wd,wd->w", steps, steps)
        weights = np.exp(log_weights - log_weights.max())
        effective = float(weights.sum() ** 2 / (weights @ weights) / size)
        return z[np.isfinite(value)], effective


def _curvature(density: _Normal, step: float) -> tuple[FloatArray, int]:
    """Minus the second derivatives (d, d) of a log density at its peak, along its root's columns.

    Also returns the number of directions in which the model fails beside the peak. There, the
    curvature is 1, as the Fisher information says.
    """
    d = density.peak.size
    rows, columns = np.tril_indices(d)
    one, other = step * np.eye(d)[rows], step * np.eye(d)[columns]
    shifts = np.concatenate([one + other, one - other, other - one, -one - other])
    values = density.log_posterior(shifts)[1].reshape(4, -1)
    matrix = np.empty((d, d))
    with np.errstate(invalid="ignore"):
        second = (values[1] + values[2] - values[0] - values[3]) / (4.0 * step**2)
    matrix[rows, columns] = matrix[columns, rows] = second
    failed = ~np.isfinite(np.diagonal(matrix))
    matrix[~np.isfinite(matrix)] = 0.0
    matrix[failed] = matrix[:, failed] = 0.0
    matrix[failed, failed] = 1.0
    return matrix, int(failed.sum())
