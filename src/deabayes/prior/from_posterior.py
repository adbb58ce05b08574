"""A posterior as the prior of another study, in the default prior's coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deabayes.distributions.scores import FloatArray, log_normal_density
from deabayes.prior.transport import Transport, distance_from_normal, fit_transport

LARGEST_MISFIT = 0.05
"""Distance of distribution functions from which a prior made of draws is called approximate."""


class PriorFromPosterior(NamedTuple):
    """Draws of another posterior, to be used as a prior."""

    names: tuple[str, ...]
    draws: FloatArray
    """(S, k), SI."""

    def __repr__(self) -> str:
        return f"<Prior from {len(self.draws)} draws of {', '.join(self.names)}>"


@dataclass(frozen=True)
class PosteriorBlock:
    """What makes draws of another posterior, in the default prior's standard-normal coordinate.

    `misfit` is how far the draws, whitened by the transport, are from standard normal
    (`distance_from_normal`).
    """

    names: tuple[str, ...]
    transport: Transport
    misfit: float

    @classmethod
    def fit(cls, names: tuple[str, ...], z: FloatArray) -> PosteriorBlock:
        """Fit to draws z (S, k) in the default coordinate (see `fit_transport`).

        Raises
        ------
        UserError : too few draws, or draws without spread.
        """
        transport = fit_transport(z, names)
        return cls(names, transport, distance_from_normal(transport.whiten(z)))

    def of(self, names: Sequence[str]) -> PosteriorBlock | None:
        """The marginal of those of its parameters that are named; None if none is."""
        kept = [k for k, name in enumerate(self.names) if name in names]
        if len(kept) == len(self.names) or not kept:
            return self if kept else None
        own = tuple(self.names[k] for k in kept)
        return PosteriorBlock(own, self.transport.marginal(kept), self.misfit)

    def colour(self, z: FloatArray) -> FloatArray:
        """Default coordinate (W, k) of the standard normal z (W, k)."""
        return self.transport.colour(z)

    def whiten(self, z_default: FloatArray) -> FloatArray:
        """Inverse of `colour`."""
        return self.transport.whiten(z_default)

    def log_density_ratio(self, z_default: FloatArray) -> FloatArray:
        """log p(z_default) of the transport - log N(z_default; 0, I), (W,)."""
        default = np.sum(log_normal_density(z_default), axis=1)
        return self.transport.log_density(z_default) - default

    def describe(self) -> str:
        """What it is, in words, for tables."""
        return f"posterior of another study, {self.transport.describe()} on the scores"
