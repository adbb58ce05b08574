"""Coordinates in which a posterior's ridges are straight, as a chain of maps of z.

The sampler is given them by whoever knows the model: the prior (logarithms in place of scores),
the noise model and the system. Proposals are fitted, and differences of walkers taken, in u.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deabayes.experiment import FloatArray


class Part(Protocol):
    """A map of some columns of u, made in place."""

    def straighten(self, u: FloatArray) -> FloatArray | float:
        """Change columns of u (W, d) and return the log of the Jacobian, (W,) or one for all."""
        ...

    def bend(self, u: FloatArray) -> None:
        """Undo it; NaN outside the support."""
        ...


@dataclass(frozen=True)
class Coordinates:
    """The map u = straighten(z) and its inverse; the identity without parts."""

    parts: tuple[Part, ...] = ()

    def straighten(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u of z (W, d), and log |du / dz|, (W,); -inf where it is lost."""
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
        """The z (W, d) of u; rows outside the prior's support are NaN."""
        if not self.parts:
            return u
        z = u.copy()
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            for part in reversed(self.parts):
                part.bend(z)
        z[~np.isfinite(z).all(axis=1)] = np.nan
        return z
