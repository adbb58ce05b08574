"""Where climbs to other peaks may begin: one relaxation unit taken to another time constant."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from math import ceil
from typing import Self

import numpy as np
from scipy.special import ndtr, ndtri

from deabayes.experiment import FloatArray
from deabayes.prior.joint import Prior
from deabayes.sampling.units import Units, units_of

SPACING = 0.2
"""Of the prior's probability, at most, between two places of one gap between other units."""
STRENGTHS = 1.0, 10.0
"""What its stiffness is multiplied by: a unit that does nothing where it is must do something to
be seen elsewhere."""


@dataclass(frozen=True)
class Elsewhere:
    """Places of a prior's z that differ from a given one by where one relaxation unit is.

    A motion that one unit of 8 ms damps is damped, badly, by one of 0.25 s too; while records count
    for little the second has more of the prior, and between the two no particle passes (four Ogden
    terms and one unit: 1100 nats). A unit that tempering left where it does nothing may be wanted
    beyond the slowest (four units: 10 nats).
    """

    prior: Prior
    groups: tuple[Units, ...]

    @classmethod
    def of(cls, prior: Prior) -> Self | None:
        """Those of a prior; None where it has no time constants."""
        groups = [each for each in units_of(prior, fewest=1) if _are_times(prior, each)]
        return cls(prior, tuple(groups)) if groups else None

    def __call__(self, z: FloatArray) -> FloatArray:
        """From z (d,), the places (K, d) in the prior's support, numbered anew where need be."""
        theta = self.prior.to_parameters(z[None])[0]
        moved = np.concatenate([self._moved(theta, units) for units in self.groups])
        places = self.prior.to_normal(moved)
        return places[np.isfinite(places).all(axis=1)]

    def _moved(self, theta: FloatArray, units: Units) -> FloatArray:
        """theta (p,) with every unit of a group at each of its places, (K, p)."""
        moved = []
        for unit in range(units.count):
            time, *companions = units.columns[:, unit]
            for place, strength in product(self._places(theta, units, unit), STRENGTHS):
                moved.append(theta.copy())
                moved[-1][time] = place
                moved[-1][companions] *= strength
        return units.renumbered(np.array(moved))

    def _places(self, theta: FloatArray, units: Units, unit: int) -> FloatArray:
        """Time constants evenly over the gaps that the other units leave of the prior."""
        columns = np.delete(units.columns[0], unit)
        prior = self.prior.parameters[units.columns[0, unit]].prior
        taken = np.sort(ndtr(prior.to_normal(theta[columns])))
        ends = np.concatenate([[0.0], taken, [1.0]])
        found = []
        for low, high in pairwise(ends):
            count = max(ceil((high - low) / SPACING), 1)
            found.append(low + (high - low) * (np.arange(count) + 0.5) / count)
        return prior.from_normal(ndtri(np.concatenate(found)))


def _are_times(prior: Prior, units: Units) -> bool:
    return all(prior.parameters[column].unit == "s" for column in units.columns[0])
