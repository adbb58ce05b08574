r"""Many relaxation units: each against all slower ones together.

Sum and mean of all units (see `shares`) are those of the largest. Where two small ones, beside
larger ones that records resolve, share what is seen of both, neither holds along their ridge. So
units are taken together from the slowest on. With v_i what records show of unit i,

S_i = sum_{j >= i} v_j, M_i = sum_{j >= i} v_j ln tau_j / S_i, w_i = v_i / S_i,
u: M_1, (w_i (1 - w_i))^(1/2) (M_{i+1} - ln tau_i), i = 1 .. n - 1; ln S_1, ln(v_i / S_{i+1}),

where the second is the standard deviation of ln tau over unit i and the slower ones as one: the
line along which the smaller of both goes out, the further the smaller, is one of a constant u.
A unit and the next slower one trade at constant S_i, M_i and, with those, at constant u of all
faster ones. Without the roots the Jacobian of u by the logarithms is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.systems.ridges.shares import Parts


@dataclass(frozen=True)
class NestedShares(Parts):
    """Coordinates of units of which places ascend, each against the slower ones together."""

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; log of the Jacobian, (W,)."""
        where, shown = self._places_and_shown(u)
        total, mean = shown[:, -1], where[:, -1]
        log_jacobian = np.full(len(u), self._log_slopes)
        for i in range(len(self.places) - 2, -1, -1):
            own, place = shown[:, i], where[:, i]
            u[:, self.sizes[i + 1]] = own - total
            log_share, log_rest = _log_shares(own - total)
            log_root = 0.5 * (log_share + log_rest)
            u[:, self.places[i + 1]] = np.exp(log_root) * (mean - place)
            log_jacobian += log_root
            mean = mean + np.exp(log_share) * (place - mean)
            total = np.logaddexp(total, own)
        u[:, self.places[0]], u[:, self.sizes[0]] = mean, total
        return log_jacobian

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        where, shown = u[:, list(self.places)], u[:, list(self.sizes)]
        mean, total = where[:, 0].copy(), shown[:, 0].copy()
        for i in range(len(self.places) - 1):
            log_share, log_rest = _log_shares(shown[:, i + 1])
            distance = where[:, i + 1] * np.exp(-0.5 * (log_share + log_rest))
            where[:, i] = mean - np.exp(log_rest) * distance
            shown[:, i] = total + log_share
            mean = mean + np.exp(log_share) * distance
            total = total + log_rest
        where[:, -1], shown[:, -1] = mean, total
        self._put(u, where, shown)


def _log_shares(log_ratio: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ln w and ln(1 - w) of ln(w / (1 - w))."""
    return -np.logaddexp(0.0, -log_ratio), -np.logaddexp(0.0, log_ratio)
