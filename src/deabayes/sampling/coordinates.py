r"""Coordinates in which what data know of a model is straight, so that maps begin there.

**Logarithms.** What a record shows of a relaxation unit that is too slow for it is its modulus
over its time constant; of one that is too fast, its modulus. In logarithms of the parameters
such ridges are straight lines and go on as such where no draw has been. In z they bend, as the
score of a log-uniform or an ordered parameter is no linear function of its logarithm: fitted to
the draws below the 90th percentile of a slow unit's time constant, a proposal was off by 39 nats
at the largest draw, in logarithms by 6 (docs/validation.md).

**Two noises.** White and correlated noise explain each other's variance where the correlation is
shorter than the spacing of the record's points. The posterior of their standard deviations is
then a quarter of a circle: in logarithms two ridges at a right angle, round the corner of which
no polynomial goes. In
u_1 = ln sqrt(w s_white^2 + s_corr^2), u_2 = ln(s_corr / (s_white sqrt(w)))
it is the line of constant u_1 (w: mean weight of white noise, see `NoiseModel`). The Jacobian of
(u_1, u_2) by the two logarithms is 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deabayes.distributions import LogNormal, LogUniform
from deabayes.experiment import FloatArray
from deabayes.normal_scores import log_normal_density
from deabayes.posterior import LogPosterior
from deabayes.prior_blocks import Block, Independent, Ordered


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
class Coordinates:
    """The map u = straighten(z) of a prior's z, with its inverse; none at all by default.

    Attributes
    ----------
    logarithmic : blocks of the prior of which the parameters' logarithms are taken.
    pairs : noises that add up.
    """

    logarithmic: tuple[Block, ...] = ()
    pairs: tuple[NoisePair, ...] = field(default=())

    @classmethod
    def of(cls, target: LogPosterior) -> Self:
        """Those of a log-posterior's parameters that have priors of their own."""
        inherited = {n for block in target.prior.inherited for n in block.names}
        free = frozenset(k for k, name in enumerate(target.names) if name not in inherited)
        return cls(_logarithmic(target, free), _noise_pairs(target, free))

    def straighten(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u of z (W, d), and log |du / dz|, (W,); -inf where rounding leaves the support."""
        log_jacobian = np.zeros(len(z))
        if not (self.logarithmic or self.pairs):
            return z, log_jacobian
        u = z.copy()
        for block in self.logarithmic:
            own = list(block.columns)
            values = block.to_parameters(z[:, own])
            with np.errstate(divide="ignore", invalid="ignore"):
                u[:, own] = np.log(values)
                log_jacobian += (log_normal_density(z[:, own]) - u[:, own]).sum(axis=1)
                log_jacobian -= block.log_density(values)
        for pair in self.pairs:
            log_jacobian += pair.straighten(u)
        lost = ~(np.isfinite(log_jacobian) & np.isfinite(u).all(axis=1))
        u[lost], log_jacobian[lost] = 0.0, -np.inf
        return u, log_jacobian

    def bend(self, u: FloatArray) -> FloatArray:
        """The z (W, d) of u; rows outside the prior's support are NaN."""
        if not (self.logarithmic or self.pairs):
            return u
        z = u.copy()
        for pair in self.pairs:
            pair.bend(z)
        with np.errstate(over="ignore", invalid="ignore"):
            for block in self.logarithmic:
                own = list(block.columns)
                z[:, own] = block.to_normal(np.exp(u[:, own]))
        z[~np.isfinite(z).all(axis=1)] = np.nan
        return z


def _logarithmic(target: LogPosterior, free: frozenset[int]) -> tuple[Block, ...]:
    """Blocks of positive parameters of which the logarithm is not linear in z already."""
    blocks: list[Block] = []
    for block in target.prior.blocks:
        if isinstance(block, Ordered):
            if isinstance(block.reduced, LogNormal | LogUniform) and free.issuperset(block.columns):
                blocks.append(block)
        elif isinstance(block, Independent):
            own = zip(block.columns, block.distributions, strict=True)
            kept = [(k, d) for k, d in own if isinstance(d, LogUniform) and k in free]
            if kept:
                blocks.append(Independent(*zip(*kept, strict=True)))
    return tuple(blocks)


def _noise_pairs(target: LogPosterior, free: frozenset[int]) -> tuple[NoisePair, ...]:
    """One for each noise group of which both have log-normal priors."""
    pairs: list[NoisePair] = []
    for group in dict.fromkeys(record.group for record in target.records):
        columns = [target.names.index(f"{group}.{name}") for name in target.noise.adding]
        priors = [target.prior.parameters[column].prior for column in columns]
        normals = [p for p in priors if isinstance(p, LogNormal)]
        if len(normals) == 2 and free.issuperset(columns):
            white, correlated = (float(np.log(p.median)) for p in normals)
            pairs.append(
                NoisePair(
                    (columns[0], columns[1]),
                    (white + 0.5 * _log_weight(target, group), correlated),
                    (normals[0].sigma, normals[1].sigma),
                )
            )
    return tuple(pairs)


def _log_weight(target: LogPosterior, group: str) -> float:
    weights: list[NDArray[np.float64]] = [r.weights for r in target.records if r.group == group]
    return float(np.log(np.mean(np.concatenate(weights))))
