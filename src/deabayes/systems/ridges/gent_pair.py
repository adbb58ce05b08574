"""A Gent spring that is stretched: what a record shows of modulus and limit is the load that the
spring takes up on its way (see `StretchedSpring`). Its logarithm takes the place of that of mu."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.coordinates import log_normals
from deabayes.prior.joint import Prior
from deabayes.systems.stretched_spring import StretchedSpring


@dataclass(frozen=True)
class GentPair:
    """Modulus and limit of a Gent spring, as columns of z.

    ln mu = constant + modulus_slope z, ln J = limit_intercept + limit_slope z.
    """

    spring: StretchedSpring
    columns: tuple[int, int]
    modulus_slope: float
    limit_intercept: float
    limit_slope: float

    def straighten(self, u: FloatArray) -> float:
        """Put the score of mu h(J) in the place of that of mu."""
        u[:, self.columns[0]] += self._log_secant(u)
        return 0.0

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        u[:, self.columns[0]] -= self._log_secant(u)

    def _log_secant(self, z: FloatArray) -> FloatArray:
        """ln h(J) on the scale of the modulus's score."""
        with np.errstate(over="ignore"):
            limit = np.exp(self.limit_intercept + self.limit_slope * z[:, self.columns[1]])
        return self.spring.log_secant(limit) / self.modulus_slope


def gent_pairs(
    prior: Prior, springs: Sequence[StretchedSpring], free: frozenset[int]
) -> list[GentPair]:
    """One for each spring that records are known to have stretched."""
    pairs: list[GentPair] = []
    for spring in springs:
        columns = [prior.names.index(name) for name in (spring.modulus, spring.limit)]
        normals = log_normals(prior, columns, free)
        if len(normals) == 2:
            modulus, limit = normals
            intercept = float(np.log(limit.median))
            places = columns[0], columns[1]
            pairs.append(GentPair(spring, places, modulus.sigma, intercept, limit.sigma))
    return pairs
