r"""Relaxation units of which data show the sum.

Where a record shows fewer units than a model has, one of them is either invisible, wherever its
time constant is, or shares what is seen with a neighbour. In the logarithms of moduli and time
constants these are boomerangs, one for each pair of neighbours. With w_i the share of unit i in
what the record shows,

u: ln sum_i v_i, ln(v_{i+1} / v_i); sum_i w_i ln tau_i, ln(tau_{i+1} / tau_i),
v_i = mu_i / (1 + tau_i / T), w_i = v_i / sum_j v_j,

the sum and the mean time stay what they are along all of them. T is how long records show a unit:
of one too slow for them, what is seen is mu_i T / tau_i. For units in series, of which
compliances add up, 1 / mu_i takes the place of mu_i. The Jacobian of u by the logarithms is 1.

Terms of a spring are such parts too (see `terms`): `Shares` says what both have in common. Which
units of a model are such parts: see `unit_shares`; of many, see `nested_shares`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray

Hidden = Callable[[FloatArray], FloatArray]
"""Places (W, n) -> the log of how much of a part at that place records do not show, (W, n)."""


@dataclass(frozen=True)
class Parts:
    """Where the parts of a sum are, and how large they are, among coordinates.

    Attributes
    ----------
    places, sizes : columns, in one order: of ln tau_i and of the scores of mu_i.
    intercepts, slopes : (n,), with +-ln mu_i = intercept + slope z.
    hidden : ln(1 + tau / T).
    """

    places: tuple[int, ...]
    sizes: tuple[int, ...]
    intercepts: FloatArray
    slopes: FloatArray
    hidden: Hidden

    def _places_and_shown(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ln tau_i and ln v_i, (W, n) each."""
        where = u[:, list(self.places)]
        return where, self.intercepts + self.slopes * u[:, list(self.sizes)] - self.hidden(where)

    def _put(self, u: FloatArray, where: FloatArray, shown: FloatArray) -> None:
        """The way back: ln tau_i and the scores of mu_i into their columns."""
        u[:, list(self.places)] = where
        u[:, list(self.sizes)] = (shown + self.hidden(where) - self.intercepts) / self.slopes

    @property
    def _log_slopes(self) -> float:
        """Log of the Jacobian of ln mu by the scores."""
        return float(np.log(np.abs(self.slopes)).sum())


@dataclass(frozen=True)
class Shares(Parts):
    """Coordinates in place of where parts are and of the scores of how large they are.

    Attributes
    ----------
    spread : the distance of neighbours is counted in what it adds to the standard deviation of
        places, s_i = (W_i (1 - W_i))^(1/2) (ln tau_{i+1} - ln tau_i), W_i = sum_{j <= i} w_j: of
        two parts it is that standard deviation, and the ridge along which the smaller one goes
        out, the further the smaller, is the line of constant s.
    """

    spread: bool = False

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; log of the Jacobian, (W,)."""
        places, sizes = list(self.places), list(self.sizes)
        where, shown = self._places_and_shown(u)
        largest = shown.max(axis=1, keepdims=True)
        total = largest + np.log(np.exp(shown - largest).sum(axis=1, keepdims=True))
        log_factors = self._log_factors(shown - total)
        u[:, places[0]] = (np.exp(shown - total) * where).sum(axis=1)
        u[:, places[1:]] = np.diff(where, axis=1) * np.exp(log_factors)
        u[:, sizes[0]] = total[:, 0]
        u[:, sizes[1:]] = np.diff(shown, axis=1)
        return log_factors.sum(axis=1) + self._log_slopes

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        places, sizes = list(self.places), list(self.sizes)
        ratios, steps = np.zeros((len(u), len(places))), np.zeros((len(u), len(places)))
        np.cumsum(u[:, sizes[1:]], axis=1, out=ratios[:, 1:])
        ratios -= ratios.max(axis=1, keepdims=True)
        log_shares = ratios - np.log(np.exp(ratios).sum(axis=1, keepdims=True))
        distances = u[:, places[1:]] * np.exp(-self._log_factors(log_shares))
        np.cumsum(distances, axis=1, out=steps[:, 1:])
        mean = (np.exp(log_shares) * steps).sum(axis=1, keepdims=True)
        where = u[:, [places[0]]] - mean + steps
        shown = u[:, [sizes[0]]] + log_shares
        self._put(u, where, shown)

    def _log_factors(self, log_shares: FloatArray) -> FloatArray:
        """Of the distances (W, n - 1), given the shares' logarithms (W, n)."""
        if not self.spread:
            return np.zeros_like(log_shares[:, 1:])
        below = np.logaddexp.accumulate(log_shares, axis=1)[:, :-1]
        above = np.logaddexp.accumulate(log_shares[:, ::-1], axis=1)[:, -2::-1]
        return 0.5 * (below + above)
