"""Laplace approximations of a density at many points at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.problem import LogDensity

CURVATURE_STEP = 0.03
"""First step of the differences, in units of the factor given."""
MOST_SCALINGS = 12


@dataclass(frozen=True)
class Points:
    """Points of a density with the Laplace approximations there.

    Attributes
    ----------
    z : (K, d).
    factors : (K, d, d), Cholesky factors of the covariances.
    value : (K,), the log density.
    """

    z: FloatArray
    factors: FloatArray
    value: FloatArray

    def at(self, which: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Points:
        """Some of the points."""
        return Points(self.z[which], self.factors[which], self.value[which])

    @classmethod
    def joined(cls, *parts: Points) -> Points:
        """All points of several sets."""
        return cls(
            np.concatenate([part.z for part in parts]),
            np.concatenate([part.factors for part in parts]),
            np.concatenate([part.value for part in parts]),
        )

    @property
    def log_mass(self) -> FloatArray:
        """Log of the mass that each approximation has, but for a constant, (K,)."""
        diagonals = np.abs(np.diagonal(self.factors, axis1=1, axis2=2))
        return self.value + np.log(diagonals).sum(axis=1)


def laplace_factors(target: LogDensity, z: FloatArray, factors: FloatArray) -> FloatArray:
    """Cholesky factors (K, d, d) of the inverse of minus the Hessian at z (K, d), made positive.

    The prior alone has the curvature 1 in z: a direction of less is one that the differences did
    not resolve.

    Parameters
    ----------
    factors : (K, d, d), whose columns are the directions of the differences.
    """
    count, d = z.shape
    steps = factors * _unit_drop_scales(target, z, factors)[:, None]
    first, second = np.tril_indices(d, -1)
    axes, pairs = np.eye(d), np.eye(d)[first] + np.eye(d)[second]
    shifts = np.concatenate([np.zeros((1, d)), axes, -axes, pairs, -pairs])
    places = z[:, None] + np.matmul(shifts, steps.transpose(0, 2, 1))
    values = target(places.reshape(-1, d)).reshape(count, -1)
    values = np.where(np.isfinite(values), values, np.nan)
    values = np.where(np.isnan(values), np.nanmin(values, axis=1, keepdims=True), values)
    here, plus, minus = values[:, :1], values[:, 1 : d + 1], values[:, d + 1 : 2 * d + 1]
    sides = plus + minus
    both = values[:, 2 * d + 1 :].reshape(count, 2, -1).sum(axis=1)
    hessian = np.zeros((count, d, d))
    hessian[:, np.arange(d), np.arange(d)] = sides - 2.0 * here
    mixed = 0.5 * (both + 2.0 * here - sides[:, first] - sides[:, second])
    hessian[:, first, second] = hessian[:, second, first] = mixed
    inverse = np.linalg.inv(steps)
    curvature = -inverse.transpose(0, 2, 1) @ hessian @ inverse
    curvature = 0.5 * (curvature + curvature.transpose(0, 2, 1))
    eigenvalues, vectors = np.linalg.eigh(curvature)
    return triangular(vectors / np.sqrt(np.maximum(eigenvalues, 1.0))[:, None])


def triangular(roots: FloatArray) -> FloatArray:
    """The Cholesky factors of root root' (K, d, d), also where that product loses a direction."""
    upper = np.linalg.qr(roots.transpose(0, 2, 1), mode="r")
    signs = np.where(np.diagonal(upper, axis1=1, axis2=2) < 0.0, -1.0, 1.0)
    return np.asarray((signs[:, :, None] * upper).transpose(0, 2, 1), dtype=np.float64)


def _unit_drop_scales(target: LogDensity, z: FloatArray, factors: FloatArray) -> FloatArray:
    """How far along each column of the factors the log density falls by about a half, (K, d)."""
    count, d = z.shape
    scales = np.full((count, d), CURVATURE_STEP)
    open_ = np.arange(count)
    for _ in range(MOST_SCALINGS):
        moves = (factors[open_] * scales[open_][:, None]).transpose(0, 2, 1)
        here = z[open_][:, None]
        places = np.concatenate([here, here + moves, here - moves], axis=1)
        values = target(places.reshape(-1, d)).reshape(open_.size, -1)
        drop = values[:, :1] - 0.5 * (values[:, 1 : d + 1] + values[:, d + 1 :])
        drop = np.where(np.isfinite(drop), drop, np.inf)
        settled = ((drop > 0.1) & (drop < 2.0)).all(axis=1)
        open_, drop = open_[~settled], drop[~settled]
        if not open_.size:
            break
        scales[open_] *= np.clip(np.sqrt(0.5 / np.maximum(drop, 1e-3)), 0.1, 5.0)
    return scales
