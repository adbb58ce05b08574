"""Coordinates of a made-up prior (two ordered times, a uniform parameter, noise), and checks."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior
from deabayes.noise.base import NoisePair
from deabayes.posteriors.problem import problem_of
from deabayes.prior.coordinates import Natural
from deabayes.prior.distributions import LogUniform, Uniform
from deabayes.prior.ordered import Ordered
from deabayes.sampling.problem import Coordinates, Part

TIMES, WIDE = LogUniform(0.01, 10.0), Uniform(-1.0, 5.0)
WEIGHT, SLOPES = 0.2, (1.5, 1.2)
COORDINATES = Coordinates(
    (
        Natural(Ordered.of("tau", (0, 1), TIMES, 2.0)),
        Natural(Ordered((2,), WIDE, np.ones(1))),
        NoisePair((3, 4), (0.5 * np.log(WEIGHT), 0.0), SLOPES),
    )
)


def coordinates_of(target: LogPosterior) -> Coordinates:
    """Those that the sampler is given with a posterior."""
    return problem_of(target).coordinates


def parts_of(target: LogPosterior, *kinds: type) -> list[Part]:
    """The parts of some kinds among them."""
    return [part for part in coordinates_of(target).parts if isinstance(part, kinds)]


def check_there_and_back(
    there: Coordinates, z: FloatArray, back: float = 1e-7, jacobian: float = 1e-5
) -> None:
    """`bend` undoes `straighten`, and the Jacobian is that of finite differences at z (W, d)."""
    u, log_jacobian = there.straighten(z)
    np.testing.assert_allclose(there.bend(u), z, atol=back)
    step = 1e-5
    columns = [
        (there.straighten(z + step * e)[0] - there.straighten(z - step * e)[0]) / (2 * step)
        for e in np.eye(z.shape[1])
    ]
    expected = np.linalg.slogdet(np.stack(columns, axis=2))[1]
    np.testing.assert_allclose(log_jacobian, expected, atol=jacobian)
