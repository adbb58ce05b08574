"""A Gent spring between two stretches, and the stress difference that records determine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Specimen

REACHED = 0.98
"""Assumed largest stretch, as a share of the way to the largest recorded value, which has noise."""
CLOSEST = 1.05
"""Smallest ratio of the limit J to I_1 - 3 for h(J); below it h is constant. So a record with a
wrong reading does not exclude a limit."""


@dataclass(frozen=True)
class StretchedSpring:
    r"""A Gent spring, P(lambda) = mu p(lambda) / (1 - i(lambda)/J), i = I_1 - 3.

    If the spring carries an additional load at lambda_1 compared with lambda_0, records determine
    P(lambda_1) - P(lambda_0) = mu h(J) far better than mu or J.

    Attributes
    ----------
    modulus, limit : names of mu and J.
    shapes, invariants : p and i at lambda_0 and at lambda_1.
    """

    modulus: str
    limit: str
    shapes: tuple[float, float]
    invariants: tuple[float, float]

    def log_secant(self, limit: FloatArray) -> FloatArray:
        """ln h(J), (W,); a limit below CLOSEST times the invariant is replaced by this value."""
        limit = np.maximum(limit, CLOSEST * self.invariants[1])
        before, after = (
            shape / (1.0 - invariant / limit)
            for shape, invariant in zip(self.shapes, self.invariants, strict=True)
        )
        return np.asarray(np.log(after - before))


def equal_biaxial(
    modulus: str, limit: str, specimen: Specimen, experiments: Sequence[Experiment]
) -> tuple[StretchedSpring, ...]:
    """Return the membrane's spring from pre-stretch to the largest recorded stretch, if larger."""
    rest = specimen.quantities["prestretch"].value
    side = specimen.quantities.get("side_length")
    largest = [_largest(e, rest, 1.0 if side is None else side.value) for e in experiments]
    reached = rest + REACHED * (max([rest, *largest]) - rest)
    if not reached > rest:
        return ()
    shapes = rest - rest**-5, reached - reached**-5
    invariants = 2 * rest**2 + rest**-4 - 3, 2 * reached**2 + reached**-4 - 3
    return (StretchedSpring(modulus, limit, shapes, invariants),)


def _largest(experiment: Experiment, rest: float, side: float) -> float:
    """Largest stretch in a record of stretch, displacement or area."""
    value = float(np.max(experiment.response))
    if experiment.response_name == "displacement":
        return rest + value / side
    return value if experiment.response_name == "stretch" else float(np.sqrt(value)) / side
