"""The sampling problem: a likelihood of z under the prior N(0, I), and hints on its shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import log, pi
from typing import NamedTuple, Protocol

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.sampling.mixture import RandomSource

LogDensity = Callable[[FloatArray], FloatArray]
Hop = Callable[[FloatArray, RandomSource], tuple[FloatArray, FloatArray]]
"""z (W, d) -> proposed z' (W, d), and the log factor (W,) on the ratio of posterior densities."""


class EveryDrawFailed(UserError):
    """No particle has a finite likelihood; the caller names the records that cause it."""


class Part(Protocol):
    """An in-place map of some columns of u, made by the prior, the noise model or the system."""

    def straighten(self, u: FloatArray) -> FloatArray | float:
        """Change columns of u (W, d) and return the log Jacobian, (W,) or one for all rows."""
        ...

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`; columns are NaN outside the support."""
        ...


@dataclass(frozen=True)
class Coordinates:
    """The map u = straighten(z) and its inverse; the parts are applied one after another.

    Without parts, the map is the identity. Ridges of the posterior are straight in u. Proposals are
    fitted in u, and differences of walkers are taken in u.
    """

    parts: tuple[Part, ...] = ()

    def straighten(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return u for z (W, d), and log |du / dz|, (W,), which is -inf where the map fails."""
        log_jacobian = np.zeros(len(z))
        if not self.parts:
            return z, log_jacobian
        u = z.copy()
        with np.errstate(divide="ignore", invalid="ignore"):
            for part in self.parts:
                log_jacobian += part.straighten(u)
        lost = ~(np.isfinite(log_jacobian) & np.isfinite(u).all(axis=1))
        u[lost], log_jacobian[lost] = 0.0, -np.inf
        return u, log_jacobian

    def bend(self, u: FloatArray) -> FloatArray:
        """Return z (W, d) for u; rows outside the prior's support are NaN."""
        if not self.parts:
            return u
        z = u.copy()
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            for part in reversed(self.parts):
                part.bend(z)
        z[~np.isfinite(z).all(axis=1)] = np.nan
        return z


class Split(NamedTuple):
    """A log-likelihood by the points of the records: rest + sum_k (-score_k^2 / 2 - log_scale_k).

    The first derivatives of its terms give nearly all of its curvature, as the derivatives of
    residuals do in least squares.

    Attributes
    ----------
    scores : (W, P), standard normal if the model holds.
    log_scales : (W, P), minus the log derivatives of the scores by the responses.
    rest : (W,), the terms that belong to no point.
    """

    scores: FloatArray
    log_scales: FloatArray
    rest: FloatArray

    @property
    def total(self) -> FloatArray:
        """The log-likelihood (W,); NaN where the model fails."""
        squares = np.einsum("wp,wp->w", self.scores, self.scores)
        return np.asarray(self.rest - 0.5 * squares - self.log_scales.sum(axis=1))


Quantities = Callable[[FloatArray], Mapping[str, FloatArray]]


def _coordinates_of(z: FloatArray) -> dict[str, FloatArray]:
    return {f"z_{index + 1}": column for index, column in enumerate(z.T)}


@dataclass(frozen=True)
class Problem:
    """A posterior over z, with hints that help to sample it.

    Only the likelihood decides what is sampled.

    Attributes
    ----------
    log_likelihood : z (W, d) -> (W,); NaN or -inf where the model fails.
    dimension : d.
    coordinates : coordinates in which ridges are straight.
    hops : proposals between modes, such as another numbering of units.
    split : the `log_likelihood` by points. Without `split`, climbs assume a quadratic shape.
    rough : a cheaper problem that is nearly the same, for draws that are dropped.
    quantities : z (N, d) -> name -> (N,): parameters and derived quantities that the gates check.
    """

    log_likelihood: LogDensity
    dimension: int
    coordinates: Coordinates = field(default_factory=Coordinates)
    hops: tuple[Hop, ...] = ()
    split: Callable[[FloatArray], Split] | None = None
    rough: Problem | None = None
    quantities: Quantities = _coordinates_of


def log_standard_normal(z: FloatArray) -> FloatArray:
    """Return the log density of N(0, I) at z (W, d), the prior of every model in z."""
    return -0.5 * np.einsum("wd,wd->w", z, z) - 0.5 * z.shape[1] * log(2 * pi)


@dataclass
class Target:
    """log L(z) + log N(z; 0, I), with counts of evaluations and of values that are not finite.

    Attributes
    ----------
    by_points : log L by points.
    prior : power of N(z; 0, I); 0 if only the likelihood is climbed.
    """

    likelihood: LogDensity
    by_points: Callable[[FloatArray], Split] | None = None
    prior: float = 1.0
    evaluations: int = 0
    failures: int = 0

    def log_likelihood(self, z: FloatArray) -> FloatArray:
        """Return log L, (W,); -inf where the model fails."""
        return self._counted(np.asarray(self.likelihood(z), dtype=float))

    def split(self, z: FloatArray) -> Split:
        """Return log L by points, and count evaluations and failures by its total."""
        if self.by_points is None:
            none = np.empty((len(z), 0))
            return Split(none, none, self.log_likelihood(z))
        split = self.by_points(z)
        self._counted(split.total)
        return split

    def _counted(self, values: FloatArray) -> FloatArray:
        usable = np.isfinite(values)
        self.evaluations += len(values)
        self.failures += int((~usable).sum())
        return np.where(usable, values, -np.inf)

    def __call__(self, z: FloatArray) -> FloatArray:
        return self.log_likelihood(z) + self.prior * log_standard_normal(z)

    @property
    def counts(self) -> FloatArray:
        """Numbers of evaluations and failures so far."""
        return np.array([self.evaluations, self.failures], dtype=float)
