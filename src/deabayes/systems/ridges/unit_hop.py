r"""A proposal that takes one relaxation unit to another place in the order of units.

Ordered time constants split a posterior: a record that shows one unit of two is explained
as well with the other, invisible one faster (the visible one is then number 2) as slower
(number 1), and between the two lies the visible unit's own time constant, which nothing
that moves z a little can pass. Tempering chooses between such modes once, by chance.

The hop draws the time constant tau_k of one unit anew from its prior q and numbers the
units again, each keeping what belongs to it. Sorting is a bijection between n-sets of units
and ordered theta, so with the prior's density p on ordered theta the proposal is accepted
with min(1, L' p(theta') q(tau_k) / (L p(theta) q(tau_k'))) (Tierney 1994, Annals of Statistics
22, 1701). It changes nothing but the order in which modes are visited.

An Ogden term takes along its stress s mu_k at the stretches that its prior is of, or at the largest
on record, where those are known,
s = lambda_1^alpha_k - lambda_3^alpha_k: at another exponent the same mu_k makes another film. The
Jacobian of mu_k' = mu_k s(alpha_k) / s(alpha_k') by mu_k multiplies the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.joint import Prior
from deabayes.springs.ogden import stress_of_one
from deabayes.systems.ridges.units import Units, units_of

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
