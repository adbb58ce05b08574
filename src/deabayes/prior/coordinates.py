r"""Coordinates of a prior in which ridges of the likelihood are straight lines.

**Logarithms and values.** A record determines only the ratio of modulus to time constant of a
relaxation unit that is too slow for the record, and only the modulus of one that is too fast. In
logarithms such ridges are straight lines, also beyond all draws. In z they bend, because the
score of a log-uniform or an ordered parameter is not linear in its logarithm. The logarithm of
an Ogden term's stress at a stretch, mu lambda^alpha, is linear in ln mu and alpha.

**Inherited parameters.** Their z is whitened by one normal of the other posterior's mean and
covariance. If that posterior is a mixture, the scores of the default prior are used instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lgamma, log, sqrt

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.blocks import Independent
from deabayes.prior.distributions import LogNormal, LogUniform, Uniform
from deabayes.prior.from_posterior import PosteriorBlock
from deabayes.prior.joint import Prior
from deabayes.prior.ordered import ROUNDING, Ordered
from deabayes.prior.scores import log_normal_density

KINDS = (Uniform, LogUniform, LogNormal)


@dataclass(frozen=True)
class Natural:
    """Map from a block's scores z to its parameters, or to their logarithms.

    Uniform parameters are centred and divided by their standard deviation. All others enter by
    their logarithm. A coordinate with a uniform prior is linear in the block's order statistics,
    so no quantile of the normal distribution is computed.

    Attributes
    ----------
    block : ordered parameters, or a single parameter.
    """

    block: Ordered

    def straighten(self, u: FloatArray) -> FloatArray:
        """Transform the block's columns of u (W, d); return the log of the Jacobian, (W,)."""
        z, size = u[:, self._own], len(self._own)
        log_survivals = self.block.log_survivals(z)
        log_jacobian = log_normal_density(z).sum(axis=1) - lgamma(size + 1.0)
        if self._range is not None:
            lower, width = self._range
            survivals = np.exp(log_survivals)
            shares = survivals[:, ::-1] if self.block.from_largest else 1.0 - survivals
            u[:, self._own] = self._gaps + lower + width * shares
            return np.asarray(log_jacobian + size * log(width))
        median, sigma = self._normal
        scores = self.block.scores(log_survivals)
        u[:, self._own] = self._gaps + median + sigma * scores
        return np.asarray(log_jacobian - log_normal_density(scores).sum(axis=1) + size * log(sigma))

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`; NaN outside the support."""
        values = u[:, self._own] - self._gaps
        if self._range is not None:
            lower, width = self._range
            shares = (values - lower) / width
            survivals = shares[:, ::-1] if self.block.from_largest else 1.0 - shares
            log_survivals = np.log(survivals)
        else:
            from scipy.special import log_ndtr

            median, sigma = self._normal
            scores = (values - median) / sigma
            log_survivals = log_ndtr(scores[:, ::-1] if self.block.from_largest else -scores)
        u[:, self._own] = self.block.from_log_survivals(log_survivals, ROUNDING)

    @property
    def logarithmic(self) -> bool:
        """Whether the coordinates are logarithms of the parameters."""
        return not isinstance(self.block.reduced, Uniform)

    @cached_property
    def _own(self) -> list[int]:
        return list(self.block.columns)

    @cached_property
    def _gaps(self) -> FloatArray:
        """Sum of the logarithms of the minimum ratios up to each parameter."""
        return np.log(self.block.factors)

    @cached_property
    def _range(self) -> tuple[float, float] | None:
        """Lower end and width of the coordinate, if its prior is uniform; else None."""
        prior = self.block.reduced
        if isinstance(prior, Uniform):
            return -sqrt(3.0), sqrt(12.0)
        if isinstance(prior, LogUniform):
            return log(prior.lower), log(prior.upper / prior.lower)
        return None

    @property
    def _normal(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of log-normal parameters."""
        prior = self.block.reduced
        assert isinstance(prior, LogNormal)
        return log(prior.median), prior.sigma


@dataclass(frozen=True)
class Inherited:
    """Map from z to the default prior's scores, for parameters inherited from a posterior.

    Attributes
    ----------
    columns : columns of z, in the block's order.
    """

    columns: tuple[int, ...]
    block: PosteriorBlock

    def straighten(self, u: FloatArray) -> FloatArray:
        """Transform the block's columns of u (W, d); return the log of the Jacobian, (W,)."""
        own = list(self.columns)
        z = u[:, own]
        u[:, own] = self.block.base.colour(z)
        return log_normal_density(z).sum(axis=1) - self.block.base.log_density(u[:, own])

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`."""
        own = list(self.columns)
        u[:, own] = self.block.base.whiten(u[:, own])


def prior_coordinates(prior: Prior) -> tuple[list[Natural | Inherited], frozenset[int]]:
    """Coordinate maps of a prior, and all columns but those inherited as a single normal."""
    bent, straight = list[Natural | Inherited](), list[int]()
    for block in prior.inherited:
        columns = tuple(prior.names.index(name) for name in block.names)
        if block.mixture.components > 1:
            bent.append(Inherited(columns, block))
        else:
            straight += columns
    free = frozenset(range(len(prior.names))).difference(straight)
    return [*bent, *_natural(prior, free)], free


def log_normals(prior: Prior, columns: Sequence[int], free: frozenset[int]) -> list[LogNormal]:
    """Return the log-normal priors of those `columns` that are also in `free`."""
    priors = [prior.parameters[column].prior for column in columns]
    return [
        p for p, k in zip(priors, columns, strict=True) if isinstance(p, LogNormal) and k in free
    ]


def _natural(prior: Prior, free: frozenset[int]) -> Iterator[Natural]:
    """Yield the maps of ordered parameters and of single log-uniform parameters."""
    for block in prior.blocks:
        if isinstance(block, Ordered):
            if isinstance(block.reduced, KINDS) and free.issuperset(block.columns):
                yield Natural(block)
        elif isinstance(block, Independent):
            for column, distribution in zip(block.columns, block.distributions, strict=True):
                if isinstance(distribution, LogUniform) and column in free:
                    yield Natural(Ordered((column,), distribution, np.ones(1)))
