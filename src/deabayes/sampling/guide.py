"""What is known of a posterior's shape before it is sampled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.elsewhere import Elsewhere
from deabayes.sampling.mixture import RandomSource
from deabayes.sampling.unit_hop import UnitHop

Hop = Callable[[FloatArray, RandomSource], tuple[FloatArray, FloatArray]]
"""z (W, d) -> proposed z' (W, d), log of the factor that N(z')/N(z) is multiplied by (W,)."""


@dataclass(frozen=True)
class Guide:
    """A proposal between modes, and coordinates in which a ridge is straight. Both may be missing.

    Nothing here changes what is sampled, only how fast.

    Attributes
    ----------
    hop : see `unit_hop`; None where there is nothing to number anew.
    coordinates : in which maps begin.
    elsewhere : z (d,) -> places (K, d) from which other peaks may be climbed to; None for none.
    several : whether a step makes several independence proposals, which is worth it where many
        draws are solved for in hardly more time than a few.
    """

    hop: Hop | None = None
    coordinates: Coordinates = field(default_factory=Coordinates)
    several: bool = False
    elsewhere: Elsewhere | None = None

    @classmethod
    def of(cls, target: LogPosterior) -> Self:
        """That of a log-posterior over its prior's z."""
        stretches = target.system.largest_stretches([r.experiment for r in target.records])
        hop = UnitHop.of(target.prior, stretches)
        elsewhere = Elsewhere.of(target.prior)
        return cls(hop, Coordinates.of(target), target.system.cheap, elsewhere)


NO_GUIDE = Guide()
"""Nothing is known."""
