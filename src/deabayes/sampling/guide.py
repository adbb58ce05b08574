"""What is known of a posterior's shape before it is sampled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.elsewhere import Elsewhere
from deabayes.sampling.film_moments import FilmMoments
from deabayes.sampling.mixture import RandomSource
from deabayes.sampling.term_trade import TermTrade
from deabayes.sampling.unit_hop import UnitHop

Hop = Callable[[FloatArray, RandomSource], tuple[FloatArray, FloatArray]]
"""z (W, d) -> proposed z' (W, d), log of the factor that N(z')/N(z) is multiplied by (W,)."""


@dataclass(frozen=True)
class Guide:
    """Proposals between modes, and coordinates in which a ridge is straight. Either may be missing.

    Nothing here changes what is sampled, only how fast.

    Attributes
    ----------
    hops : see `unit_hop` and `term_trade`; none where there is nothing to number anew.
    coordinates : in which maps begin.
    elsewhere : z (d,) -> places (K, d) from which other peaks may be climbed to; None for none.
    several : whether a step makes several independence proposals, which is worth it where many
        draws are solved for in hardly more time than a few.
    """

    hops: tuple[Hop, ...] = ()
    coordinates: Coordinates = field(default_factory=Coordinates)
    several: bool = False
    elsewhere: Elsewhere | None = None

    @classmethod
    def of(cls, target: LogPosterior) -> Self:
        """That of a log-posterior over its prior's z."""
        stretches = target.system.largest_stretches([r.experiment for r in target.records])
        hop, coordinates = UnitHop.of(target.prior, stretches), Coordinates.of(target)
        films = (pair for pair in coordinates.pairs if isinstance(pair, FilmMoments))
        trades = (TermTrade.of(target.prior, film) for film in films)
        hops: list[Hop] = [] if hop is None else [hop]
        return cls((*hops, *trades), coordinates, target.system.cheap, Elsewhere.of(target.prior))


NO_GUIDE = Guide()
"""Nothing is known."""
