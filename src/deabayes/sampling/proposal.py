"""Frozen proposals: a mixture in straightened coordinates together with a plain mixture."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.mixture import Mixture, RandomSource
from deabayes.sampling.mixture import fit as fit_mixture
from deabayes.sampling.problem import Coordinates
from deabayes.sampling.warp import Warp, fit_warp

STRAIGHTENED, PLAIN, COVERING = 0.95, 0.05, 0.2
"""Shares of straightened and plain mixture, and of the part that covers regions both miss."""
MOST_DRAWS = 8000
"""Most draws that a proposal is fitted to; more hardly improve it, and fits took most time."""
SPARE = 8
"""Extra draws, because some may fall outside the prior's support."""


@dataclass(frozen=True)
class Part:
    """A mixture, in coordinates straightened by a map or in u itself."""

    weight: float
    mixture: Mixture
    warp: Warp | None = None

    def log_density(self, u: FloatArray) -> FloatArray:
        if self.warp is None:
            return self.mixture.log_density(u)
        x, log_jacobian = self.warp.straighten(u)
        return self.mixture.log_density(x) + log_jacobian

    def sample(self, rng: RandomSource, n: int) -> FloatArray:
        x = self.mixture.sample(rng, n)
        return x if self.warp is None else self.warp.inverse(x)


@dataclass(frozen=True)
class Lines:
    """Coordinates x in which a ridge is straight: those of a map, or u itself."""

    coordinates: Coordinates
    warp: Warp | None = None

    def straighten(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x for z (W, d), and log |dx/dz|, (W,)."""
        u, log_jacobian = self.coordinates.straighten(z)
        if self.warp is None:
            return u, log_jacobian
        x, further = self.warp.straighten(u)
        return x, log_jacobian + further

    def moved(
        self, z: FloatArray, log_jacobian: FloatArray, x: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return where steps from z to x lead, (W, d), and their log acceptance factor, (W,).

        A step symmetric in x has the ratio |dx/dz| / |dx'/dz'| of its densities in z. A step out of
        the prior's support stays at z, with the log factor -inf.

        Parameters
        ----------
        log_jacobian : log |dx/dz| at z.
        """
        proposed = self.coordinates.bend(x if self.warp is None else self.warp.inverse(x))
        inside = ~np.isnan(proposed[:, 0])
        proposed = np.where(inside[:, None], proposed, z)
        with np.errstate(invalid="ignore"):
            factor = log_jacobian - self.straighten(proposed)[1]
        return proposed, np.where(inside & (factor < np.inf), factor, -np.inf)


@dataclass(frozen=True)
class Proposal:
    """A density over z that can be sampled: a weighted sum of parts, which are densities of u.

    The density is normalised if the prior's support has no bounds in u. Otherwise `sample` draws
    only inside the support, and `log_density` is the log density up to a constant.
    """

    parts: tuple[Part, ...]
    coordinates: Coordinates = field(default_factory=Coordinates)

    @property
    def dimension(self) -> int:
        return self.parts[0].mixture.dimension

    def log_density(self, z: FloatArray) -> FloatArray:
        """Return the log density (W,) at z (W, d)."""
        u, log_jacobian = self.coordinates.straighten(np.atleast_2d(z))
        terms = np.stack([np.log(part.weight) + part.log_density(u) for part in self.parts])
        largest = terms.max(axis=0)
        return log_jacobian + largest + np.log(np.exp(terms - largest).sum(axis=0))

    @property
    def lines(self) -> tuple[tuple[float, Lines], ...]:
        """Weight and `Lines` of each part with a map; ridges are straight along these lines."""
        return tuple(
            (part.weight, Lines(self.coordinates, part.warp))
            for part in self.parts
            if part.warp is not None
        )

    def sample(self, rng: RandomSource, n: int) -> FloatArray:
        """Draw n points (n, d), all inside the prior's support."""
        z = np.empty((0, self.dimension))
        while len(z) < n:
            more = self.coordinates.bend(self._draw(rng, n + SPARE))
            z = np.concatenate([z, more[~np.isnan(more[:, 0])]])
        return z[:n]

    def _draw(self, rng: RandomSource, n: int) -> FloatArray:
        """Draw n points (n, d) in u."""
        part = rng.choice(len(self.parts), size=n, p=[part.weight for part in self.parts])
        u = np.empty((n, self.dimension))
        for index in range(len(self.parts)):
            chosen = part == index
            u[chosen] = self.parts[index].sample(rng, int(chosen.sum()))
        return u


def fit(
    samples: FloatArray,
    components: int,
    rng: np.random.Generator,
    log_density: FloatArray | None = None,
    coordinates: Coordinates | None = None,
) -> Proposal:
    """Fit a proposal to samples (n, d) and freeze it.

    With enough samples, most of the proposal is a mixture in straightened coordinates. A plain
    mixture covers regions that the polynomials do not reach.

    Parameters
    ----------
    log_density : log density (n,) of the target at the samples, up to a constant. If given, a part
        of the proposal is fitted to samples that the rest covers badly. These are resampled by the
        square root of target over proposal. An independence sampler is slowed most by the few
        regions where that ratio is large. (By the ratio itself, a few samples would take all the
        weight.)
    coordinates : coordinates in which the proposal is fitted.
    """
    coordinates = coordinates or Coordinates()
    usable = np.isfinite(samples).all(axis=1)
    if log_density is not None:
        usable &= np.isfinite(log_density)
    if usable.sum() > MOST_DRAWS:
        usable = rng.choice(np.flatnonzero(usable), MOST_DRAWS, replace=False)
    u, log_jacobian = coordinates.straighten(samples[usable])
    kept = np.isfinite(log_jacobian)
    u = u[kept]
    parts = _parts(u, components, rng)
    if log_density is None:
        return Proposal(tuple(parts), coordinates)
    excess = (log_density[usable] - log_jacobian)[kept] - Proposal(tuple(parts)).log_density(u)
    weights = np.exp(0.5 * np.clip(excess - np.median(excess), -10.0, 10.0))
    missed = u[rng.choice(len(u), size=len(u), p=weights / weights.sum())]
    parts = [replace(part, weight=(1.0 - COVERING) * part.weight) for part in parts]
    parts += _parts(missed, max(components // 2, 1), rng, COVERING)
    return Proposal(tuple(parts), coordinates)


def _parts(
    u: FloatArray,
    components: int,
    rng: np.random.Generator,
    weight: float = 1.0,
) -> list[Part]:
    """Fit parts with a total weight to u (n, d): straightened and plain, or only plain."""
    plain = fit_mixture(u, components, rng)
    warp = fit_warp(u)
    if warp is None:
        return [Part(weight, plain)]
    straightened = fit_mixture(warp.forward(u), components, rng)
    return [Part(weight * STRAIGHTENED, straightened, warp), Part(weight * PLAIN, plain)]
