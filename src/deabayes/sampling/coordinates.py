r"""Coordinates in which what data know of a model is straight, so that maps begin there.

**Logarithms.** What a record shows of a relaxation unit that is too slow for it is its modulus
over its time constant; of one that is too fast, its modulus. In logarithms of the parameters
such ridges are straight lines and go on as such where no draw has been. In z they bend, as the
score of a log-uniform or an ordered parameter is no linear function of its logarithm: fitted to
the draws below the 90th percentile of a slow unit's time constant, a proposal was off by 39 nats
at the largest draw, in logarithms by 6 (docs/validation.md).

**Pairs.** See `pairs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from deabayes.distributions import LogNormal, LogUniform
from deabayes.experiment import FloatArray
from deabayes.normal_scores import log_normal_density
from deabayes.posterior import LogPosterior
from deabayes.prior_blocks import Block, Independent, Ordered
from deabayes.sampling.pairs import Pair, gent_pairs, noise_pairs


@dataclass(frozen=True)
class Coordinates:
    """The map u = straighten(z) of a prior's z, with its inverse; none at all by default.

    Attributes
    ----------
    logarithmic : blocks of the prior of which the parameters' logarithms are taken.
    pairs : see `pairs`; they come after.
    """

    logarithmic: tuple[Block, ...] = ()
    pairs: tuple[Pair, ...] = ()

    @classmethod
    def of(cls, target: LogPosterior) -> Self:
        """Those of a log-posterior's parameters that have priors of their own."""
        inherited = {n for block in target.prior.inherited for n in block.names}
        free = frozenset(k for k, name in enumerate(target.names) if name not in inherited)
        pairs: list[Pair] = [*noise_pairs(target, free), *gent_pairs(target, free)]
        return cls(_logarithmic(target, free), tuple(pairs))

    def straighten(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u of z (W, d), and log |du / dz|, (W,); -inf where it is lost."""
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
