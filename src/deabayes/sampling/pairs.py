r"""Pairs of parameters of which data know a function that is no product of powers.

**Two noises.** White and correlated noise explain each other's variance where the correlation is
shorter than the spacing of the record's points. The posterior of their standard deviations is
then a quarter of a circle: in logarithms two ridges at a right angle, round the corner of which
no polynomial goes. In
u_1 = ln sqrt(w s_white^2 + s_corr^2), u_2 = ln(s_corr / (s_white sqrt(w)))
it is the line of constant u_1 (w: mean weight of white noise, see `NoiseModel`). The Jacobian of
(u_1, u_2) by the two logarithms is 1.

**A Gent spring that is stretched.** What a record shows of modulus and limit is the load that the
spring takes up on its way (see `StretchedSpring`). Its logarithm takes the place of that of mu.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deabayes.distributions import LogNormal
from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.systems.stretched_spring import StretchedSpring


class Pair(Protocol):
    """Coordinates in the places of two others, made in place."""

    def straighten(self, u: FloatArray) -> FloatArray | float:
        """Change the columns of u (W, d) and return the log of the Jacobian, (W,) or of all."""
        ...

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        ...


@dataclass(frozen=True)
class NoisePair:
    """White and correlated noise that add up: columns of z, and ln s = intercept + slope z.

    The intercept of white noise holds that of the root of w.
    """

    columns: tuple[int, int]
    intercepts: tuple[float, float]
    slopes: tuple[float, float]

    def straighten(self, u: FloatArray) -> float:
        """Put (u_1, u_2) in the places of both; log of the Jacobian."""
        white, correlated = self._logarithms(u)
        u[:, self.columns[0]] = 0.5 * np.logaddexp(2 * white, 2 * correlated)
        u[:, self.columns[1]] = correlated - white
        return float(np.log(self.slopes).sum())

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        total, ratio = u[:, self.columns[0]], u[:, self.columns[1]]
        white = total - 0.5 * np.logaddexp(0.0, 2 * ratio)
        for column, logarithm, intercept, slope in zip(
            self.columns, (white, white + ratio), self.intercepts, self.slopes, strict=True
        ):
            u[:, column] = (logarithm - intercept) / slope

    def _logarithms(self, z: FloatArray) -> list[FloatArray]:
        terms = zip(self.columns, self.intercepts, self.slopes, strict=True)
        return [intercept + slope * z[:, column] for column, intercept, slope in terms]


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


def noise_pairs(target: LogPosterior, free: frozenset[int]) -> list[NoisePair]:
    """One for each noise group of which both have log-normal priors of their own."""
    pairs: list[NoisePair] = []
    for group in dict.fromkeys(record.group for record in target.records):
        columns = [target.names.index(f"{group}.{name}") for name in target.noise.adding]
        normals = log_normals(target, columns, free)
        if len(normals) == 2:
            white, correlated = (float(np.log(p.median)) for p in normals)
            pairs.append(
                NoisePair(
                    (columns[0], columns[1]),
                    (white + 0.5 * _log_weight(target, group), correlated),
                    (normals[0].sigma, normals[1].sigma),
                )
            )
    return pairs


def gent_pairs(target: LogPosterior, free: frozenset[int]) -> list[GentPair]:
    """One for each spring that the records are known to have stretched."""
    pairs: list[GentPair] = []
    experiments = [record.experiment for record in target.records]
    for spring in target.system.stretched_springs(experiments):
        columns = [target.names.index(name) for name in (spring.modulus, spring.limit)]
        normals = log_normals(target, columns, free)
        if len(normals) == 2:
            modulus, limit = normals
            intercept = float(np.log(limit.median))
            places = columns[0], columns[1]
            pairs.append(GentPair(spring, places, modulus.sigma, intercept, limit.sigma))
    return pairs


def log_normals(
    target: LogPosterior, columns: Sequence[int], free: frozenset[int]
) -> list[LogNormal]:
    """The priors of columns that are log-normal and the columns' own."""
    priors = [target.prior.parameters[column].prior for column in columns]
    return [
        p for p, k in zip(priors, columns, strict=True) if isinstance(p, LogNormal) and k in free
    ]


def _log_weight(target: LogPosterior, group: str) -> float:
    weights = [record.weights for record in target.records if record.group == group]
    return float(np.log(np.mean(np.concatenate(weights))))
