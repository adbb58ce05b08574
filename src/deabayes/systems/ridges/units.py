"""Coordinates and hops of relaxation units, of which records show the sum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.prior.coordinates import log_normals
from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.joint import Prior
from deabayes.systems.springs.ogden import stress_of_one


@dataclass(frozen=True)
class Units:
    """An ordered group of n parameters and what belongs to each, as columns of theta.

    Attributes
    ----------
    columns : (1 + companions, n), the ordered parameters first.
    """

    columns: NDArray[np.intp]

    @property
    def count(self) -> int:
        return self.columns.shape[1]

    def renumbered(self, theta: FloatArray) -> FloatArray:
        """theta (W, p) with units ascending, each keeping what belongs to it."""
        order = np.argsort(theta[:, self.columns[0]], axis=1)
        result = theta.copy()
        for row in self.columns:
            result[:, row] = np.take_along_axis(theta[:, row], order, axis=1)
        return result


def units_of(prior: Prior, fewest: int = 2) -> tuple[Units, ...]:
    """Groups of so many units and more, each with as many companions as the others of its group."""
    names, groups = list(prior.names), list[Units]()
    for group in dict.fromkeys(p.ordered for p in prior.parameters if p.ordered):
        members = [p.name for p in prior.parameters if p.ordered == group]
        owned = [
            [p.name for p in prior.parameters if m in (p.belongs_to, p.half_product_with)]
            for m in members
        ]
        if len(members) >= fewest and len({len(each) for each in owned}) == 1:
            rows = [members, *zip(*owned, strict=True)]
            groups.append(Units(np.array([[names.index(n) for n in row] for row in rows])))
    return tuple(groups)


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


MANY = 4
"""Units of which any two may share what is seen of them while others are resolved."""


@dataclass(frozen=True)
class TooSlow:
    """ln(1 + tau / T) of ln tau, given ln T."""

    log_duration: float

    def __call__(self, log_times: FloatArray) -> FloatArray:
        return np.logaddexp(0.0, log_times - self.log_duration)


def shown_for(experiment: Experiment) -> float:
    """How slow a unit may be to be seen relaxing [s].

    As long as a record lasts, or the period of its lowest frequency; 0 where it knows of no time.
    """
    if experiment.coordinate_name == "time":
        return float(np.ptp(experiment.coordinate))
    if experiment.coordinate_name == "frequency":
        return 1.0 / float(np.min(experiment.coordinate))
    return 0.0


def unit_shares(
    prior: Prior,
    experiments: Sequence[Experiment],
    units_add: str | None,
    free: frozenset[int],
) -> list[Shares | NestedShares]:
    """One for each group of units that have one log-normal modulus each.

    From `MANY` on each unit is counted against all slower ones together.

    Parameters
    ----------
    units_add : see `System.units_add`.
    free : columns with priors of their own.
    """
    durations = [duration for each in experiments if (duration := shown_for(each))]
    if units_add is None or not durations:
        return []
    sign = 1.0 if units_add == "moduli" else -1.0
    found: list[Shares | NestedShares] = []
    for units in units_of(prior):
        times, *companions = (tuple(row.tolist()) for row in units.columns)
        logarithmic = isinstance(prior.parameters[times[0]].prior, LogUniform | LogNormal)
        if len(companions) != 1 or not logarithmic or not free.issuperset(times):
            continue
        normals = log_normals(prior, companions[0], free)
        if len(normals) == units.count:
            medians, sigmas = np.array([(p.median, p.sigma) for p in normals]).T
            hidden = TooSlow(float(np.log(max(durations))))
            kind = NestedShares if units.count >= MANY else Shares
            found.append(kind(times, companions[0], sign * np.log(medians), sign * sigmas, hidden))
    return found


RandomSource = np.random.Generator | np.random.RandomState


@dataclass(frozen=True)
class UnitHop:
    """Proposals z -> z' of a prior with ordered units, with the factor of their acceptance.

    Attributes
    ----------
    stretches : lambda_1 and lambda_3 at which an Ogden term keeps its stress, where its prior names
        none; None: it keeps mu.
    """

    prior: Prior
    groups: tuple[Units, ...]
    stretches: tuple[float, float] | None = None

    @classmethod
    def of(cls, prior: Prior, stretches: tuple[float, float] | None = None) -> Self | None:
        """The hop of a prior; None where no group has two units to number."""
        groups = units_of(prior)
        return cls(prior, groups, stretches) if groups else None

    def __call__(self, z: FloatArray, random: RandomSource) -> tuple[FloatArray, FloatArray]:
        """Proposed z' (W, d), and the log of what L'N(z')/(L N(z)) is to be multiplied by, (W,).

        A proposal outside the prior's support is z itself with factor -inf.
        """
        units = self.groups[random.choice(len(self.groups))]
        walkers = np.arange(len(z))
        theta = self.prior.to_parameters(z)
        chosen = random.choice(units.count, size=len(z))
        column = units.columns[0][chosen]
        distribution = self.prior.parameters[units.columns[0, 0]].prior
        old = theta[walkers, column]
        new = distribution.from_normal(random.standard_normal(len(z)))
        proposed = theta.copy()
        proposed[walkers, column] = new
        carried = self._carried(units, old, new)
        if carried is not None:
            proposed[walkers, units.columns[1][chosen]] *= carried
        proposed = units.renumbered(proposed)
        factor = distribution.log_density(old) - distribution.log_density(new)
        if carried is not None:
            factor = factor + np.log(np.abs(carried))
        return weighed(self.prior, z, theta, proposed, factor)

    def _carried(self, units: Units, old: FloatArray, new: FloatArray) -> FloatArray | None:
        """What mu of a term is multiplied by, (W,); None for other units."""
        if len(units.columns) != 2:
            return None
        coefficient = self.prior.parameters[units.columns[1, 0]]
        stretches = coefficient.reference_stretches or self.stretches
        if stretches is None or coefficient.half_product_with is None:
            return None
        logarithms = np.log(stretches)
        return stress_of_one(old, *logarithms) / stress_of_one(new, *logarithms)


def weighed(
    prior: Prior, z: FloatArray, theta: FloatArray, proposed: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """z' (W, d) of theta', and the log of what L'N(z')/(L N(z)) is to be multiplied by, (W,).

    A proposal outside the prior's support is z itself with factor -inf.

    Parameters
    ----------
    theta, proposed : (W, p), of z and as proposed.
    factor : (W,), log of the density with which theta is proposed from theta' over the reverse.
    """
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        moved = prior.to_normal(proposed)
        usable = np.asarray(np.isfinite(moved).all(axis=1))
        moved = np.where(usable[:, None], moved, z)
        change = _log_density(prior, proposed, moved) - _log_density(prior, theta, z)
        change = change + factor - 0.5 * ((z**2).sum(axis=1) - (moved**2).sum(axis=1))
    return moved, np.where(usable & np.isfinite(change), change, -np.inf)


def _log_density(prior: Prior, theta: FloatArray, z: FloatArray) -> FloatArray:
    """Of the prior without what L has of it (`LogPosterior.log_likelihood_of_normal`)."""
    return prior.log_density(theta) - prior.log_correction(theta, z)
