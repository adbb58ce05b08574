"""What is known of a posterior's shape before it is sampled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.sampling.coordinates import Coordinates
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
    several : whether a step may make several independence proposals, which is worth it where many
        draws are solved for hardly more than a few.
    """

    hop: Hop | None = None
    coordinates: Coordinates = field(default_factory=Coordinates)
    several: bool = True

    @classmethod
    def of(cls, target: LogPosterior) -> Self:
        """That of a log-posterior over its prior's z."""
        stretches = target.system.largest_stretches([r.experiment for r in target.records])
        hop, several = UnitHop.of(target.prior, stretches), not target.system.costly
        return cls(hop, Coordinates.of(target), several)


NO_GUIDE = Guide()
"""Nothing is known."""
