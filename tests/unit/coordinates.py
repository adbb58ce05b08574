"""Coordinates of a made-up prior: two ordered times, a log-uniform one, noise."""

from __future__ import annotations

import numpy as np

from deabayes.distributions import LogUniform
from deabayes.prior_blocks import Independent, Ordered
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.pairs import NoisePair

WEIGHT, SLOPES = 0.2, (1.5, 1.2)
COORDINATES = Coordinates(
    (
        Ordered.of("tau", (0, 1), LogUniform(0.01, 10.0), 2.0),
        Independent((2,), (LogUniform(0.1, 10.0),)),
    ),
    (NoisePair((3, 4), (0.5 * np.log(WEIGHT), 0.0), SLOPES),),
)
