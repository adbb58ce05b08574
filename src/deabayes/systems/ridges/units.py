"""Coordinates and hops for relaxation units, because records show only the sum of the units."""

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
    """An ordered group of n parameters with their companions, as columns of theta.

    Attributes
    ----------
    columns : (1 + companions, n), the ordered parameters in the first row.
    """

    columns: NDArray[np.intp]

    @property
    def count(self) -> int:
        return self.columns.shape[1]

    def renumbered(self, theta: FloatArray) -> FloatArray:
        """Return theta (W, p) with units sorted in ascending order, together with companions."""
        order = np.argsort(theta[:, self.columns[0]], axis=1)
        result = theta.copy()
        for row in self.columns:
            result[:, row] = np.take_along_axis(theta[:, row], order, axis=1)
        return result


def units_of(prior: Prior, fewest: int = 2) -> tuple[Units, ...]:
    """Return groups of at least `fewest` units whose units have equal numbers of companions."""
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
"""Places (W, n) -> log of the ratio of a part's size to the size that records show, (W, n)."""


@dataclass(frozen=True)
class Parts:
    """Columns of coordinates that hold the places and the sizes of the parts of a sum.

    Here v_i is the size of part i that records show: ln v_i = +-ln mu_i - hidden.

    Attributes
    ----------
    places, sizes : columns of ln tau_i, and of the scores of mu_i, in the same order.
    intercepts, slopes : (n,), with +-ln mu_i = intercept + slope z.
    hidden : for relaxation units ln(1 + tau / T).
    """

    places: tuple[int, ...]
    sizes: tuple[int, ...]
    intercepts: FloatArray
    slopes: FloatArray
    hidden: Hidden

    def _places_and_shown(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ln tau_i and ln v_i, each (W, n)."""
        where = u[:, list(self.places)]
        return where, self.intercepts + self.slopes * u[:, list(self.sizes)] - self.hidden(where)

    def _put(self, u: FloatArray, where: FloatArray, shown: FloatArray) -> None:
        """Write ln tau_i and the scores of mu_i, computed from ln v_i, into their columns."""
        u[:, list(self.places)] = where
        u[:, list(self.sizes)] = (shown + self.hidden(where) - self.intercepts) / self.slopes

    @property
    def _log_slopes(self) -> float:
        """Log of the Jacobian of ln mu with respect to the scores."""
        return float(np.log(np.abs(self.slopes)).sum())


@dataclass(frozen=True)
class Shares(Parts):
    """Coordinates: mean place, distances of neighbours, log of the total, log ratios of neighbours.

    Attributes
    ----------
    spread : whether a distance is scaled by its effect on the standard deviation of the places:
        s_i = (W_i (1 - W_i))^(1/2) (ln tau_{i+1} - ln tau_i), W_i = sum_{j <= i} w_j, with w_j the
        share of part j. For two parts, s is this standard deviation. A part on a ridge is the
        farther away the smaller it is; on this ridge s is constant.
    """

    spread: bool = False

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; return the log of the Jacobian, (W,)."""
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
        """Undo `straighten`, in place."""
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
        """Log of the factors of the distances (W, n - 1), from the logs of the shares (W, n)."""
        if not self.spread:
            return np.zeros_like(log_shares[:, 1:])
        below = np.logaddexp.accumulate(log_shares, axis=1)[:, :-1]
        above = np.logaddexp.accumulate(log_shares[:, ::-1], axis=1)[:, -2::-1]
        return 0.5 * (below + above)


@dataclass(frozen=True)
class NestedShares(Parts):
    """Coordinates of units in ascending order that compare a unit with the sum of slower units."""

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; return the log of the Jacobian, (W,)."""
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
        """Undo `straighten`, in place."""
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
    """Return ln w and ln(1 - w) for a given ln(w / (1 - w))."""
    return -np.logaddexp(0.0, -log_ratio), -np.logaddexp(0.0, log_ratio)


MANY = 4
"""Fewest units for `NestedShares`: records may show the sum of any two of them, and resolve
the others."""


@dataclass(frozen=True)
class TooSlow:
    """The function ln tau -> ln(1 + tau / T), for a given ln T."""

    log_duration: float

    def __call__(self, log_times: FloatArray) -> FloatArray:
        return np.logaddexp(0.0, log_times - self.log_duration)


def shown_for(experiment: Experiment) -> float:
    """Longest relaxation time that a record can show [s].

    It is the duration of the record, or the period of its lowest frequency. It is 0 for a record
    without time and frequency.
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
    """Return coordinates for each group of units that have one log-normal modulus each.

    Groups of at least `MANY` units get `NestedShares`, smaller groups `Shares`.

    Parameters
    ----------
    units_add : see `System.units_add`.
    free : columns of the prior that are not inherited.
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
    """Proposals z -> z' for a prior with ordered units, with the factor for their acceptance.

    Attributes
    ----------
    stretches : lambda_1 and lambda_3 at which an Ogden term keeps its stress, if the prior has no
        reference stretches. If both are None, the term keeps mu.
    """

    prior: Prior
    groups: tuple[Units, ...]
    stretches: tuple[float, float] | None = None

    @classmethod
    def of(cls, prior: Prior, stretches: tuple[float, float] | None = None) -> Self | None:
        """Return the hop of a prior, or None if no group has two units."""
        groups = units_of(prior)
        return cls(prior, groups, stretches) if groups else None

    def __call__(self, z: FloatArray, random: RandomSource) -> tuple[FloatArray, FloatArray]:
        """Return proposals z' (W, d), and the log of the factor of L'N(z')/(L N(z)), (W,).

        A proposal outside the support of the prior is replaced by z, with log factor -inf.
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
        """Return the factor (W,) for mu of an Ogden term; None for other units."""
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
    """Return z' (W, d) of theta', and the log of the factor of L'N(z')/(L N(z)), (W,).

    A proposal outside the support of the prior is replaced by z, with log factor -inf.

    Parameters
    ----------
    theta, proposed : (W, p), theta of z, and the proposed theta'.
    factor : (W,), log of the ratio of the proposal densities: theta from theta' over theta' from
        theta.
    """
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        moved = prior.to_normal(proposed)
        usable = np.asarray(np.isfinite(moved).all(axis=1))
        moved = np.where(usable[:, None], moved, z)
        change = _log_density(prior, proposed, moved) - _log_density(prior, theta, z)
        change = change + factor - 0.5 * ((z**2).sum(axis=1) - (moved**2).sum(axis=1))
    return moved, np.where(usable & np.isfinite(change), change, -np.inf)


def _log_density(prior: Prior, theta: FloatArray, z: FloatArray) -> FloatArray:
    """Log-density of the prior, without the part in `LogPosterior.log_likelihood_of_normal`."""
    return prior.log_density(theta) - prior.log_correction(theta, z)
