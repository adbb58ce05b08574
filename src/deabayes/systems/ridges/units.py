"""Which parameters of a prior belong to one unit: what is ordered, and what goes along with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.prior.joint import Prior


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
