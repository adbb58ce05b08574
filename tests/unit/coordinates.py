"""Coordinates of a made-up prior: two ordered times, a uniform parameter, noise."""

from __future__ import annotations

import numpy as np

from deabayes.distributions import LogUniform, Uniform
from deabayes.prior.ordered import Ordered
from deabayes.sampling.coordinates import Coordinates, Natural
from deabayes.sampling.pairs import NoisePair

TIMES, WIDE = LogUniform(0.01, 10.0), Uniform(-1.0, 5.0)
WEIGHT, SLOPES = 0.2, (1.5, 1.2)
COORDINATES = Coordinates(
    (
        Natural(Ordered.of("tau", (0, 1), TIMES, 2.0)),
        Natural(Ordered((2,), WIDE, np.ones(1))),
    ),
    (NoisePair((3, 4), (0.5 * np.log(WEIGHT), 0.0), SLOPES),),
)
