"""NIST's nonlinear regression sets: observations, certified estimates, starting values.

The figures in `nist_strd/` are NIST's (Statistical Reference Datasets of the US National
Institute of Standards and Technology, in the public domain), digits as printed. That they were
copied without an error is tested: the sum of squares at the certified estimates, and the
linearised sds there, are the certified ones (`tests/validation/test_nist.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from deabayes.experiment import FloatArray
from tests.validation.nist_models import CURVES, Curve
from tests.validation.rows import Task, read

FOLDER = Path(__file__).with_name("nist_strd")
WIDTH = 3.0
"""Half width of a flat prior, in starting values."""
STEP = 2e-4
"""Relative difference of a parameter for derivatives."""


@dataclass(frozen=True)
class CertifiedSet:
    """One set, as certified.

    Attributes
    ----------
    starts : (2, p), the two starting values that NIST suggests.
    estimates, sds : (p,), the least-squares estimates and their linearised sds.
    """

    name: str
    difficulty: str
    curve: Curve
    x: FloatArray
    y: FloatArray
    names: tuple[str, ...]
    starts: FloatArray
    estimates: FloatArray
    sds: FloatArray
    sum_of_squares: float
    residual_sd: float

    @property
    def freedom(self) -> int:
        """n - p. (NIST prints 9 for Rat43 with 15 observations and 4 parameters; its sd has 11.)"""
        return self.y.size - len(self.names)

    @property
    def bounds(self) -> FloatArray:
        """Of the flat priors (p, 2), from NIST's second starting values (see `nist`)."""
        starts = dict(zip(self.names, self.starts[1], strict=True))
        half = {n: WIDTH * abs(starts[self.curve.scaled.get(n, n)]) for n in self.names}
        lower = {n: self.curve.lower.get(n, -np.inf) for n in self.names}
        found = {n: (max(starts[n] - half[n], lower[n]), starts[n] + half[n]) for n in self.names}
        ends = np.array([found[n] for n in self.curve.ordered or self.names])
        common = (ends[:, 0].min(), ends[:, 1].max())
        return np.array([*(found | dict.fromkeys(self.curve.ordered, common)).values()])

    def response(self, b: FloatArray) -> FloatArray:
        """(W, N) at b (W, p)."""
        return self.curve.model(self.x, *b.T[:, :, None])

    def squares(self, b: FloatArray) -> FloatArray:
        """The residual sum of squares (W,) at b (W, p)."""
        return np.asarray(np.sum((self.y - self.response(b)) ** 2, axis=1))

    @property
    def least_squares(self) -> FloatArray:
        """The estimates (p,) by two Gauss-Newton steps from the certified ones.

        These are printed to 11 digits, with which Lanczos1's sum of squares is 28 000 times
        too large.
        """
        b = self.estimates
        for _ in range(2):
            residuals = self.y - self.response(b[None])[0]
            b = b + np.abs(b) * (np.linalg.pinv(self._relative_slopes(b)) @ residuals)
        return b

    @property
    def factor(self) -> FloatArray:
        """F (p, p) with F F' the covariance of the linearised problem, s^2 (J'J)^-1."""
        b = self.estimates
        _, singular, rotation = np.linalg.svd(self._relative_slopes(b), full_matrices=False)
        return np.asarray(self.residual_sd * np.abs(b)[:, None] * rotation.T / singular)

    def _relative_slopes(self, b: FloatArray) -> FloatArray:
        """|b| dy/db (N, p), by differences of fourth order.

        Those of second order leave 1e-10, with which the sets of Lanczos are ill-conditioned enough
        for their estimates to depend on how a processor rounds.
        """
        steps = np.diag(STEP * np.abs(b))
        near, far = (self.response(b + k * steps) - self.response(b - k * steps) for k in (1, 2))
        return np.asarray((8 * near - far).T / (12 * STEP))


@cache
def certified(name: str) -> CertifiedSet:
    """A set by name."""
    parameters = [row for row in read(FOLDER / "parameters.csv") if row["set"] == name]
    points = [row for row in read(FOLDER / "observations.csv") if row["set"] == name]
    residuals = next(row for row in read(FOLDER / "residuals.csv") if row["set"] == name)
    columns = ("start_1", "start_2", "certified", "certified_sd")
    starts_1, starts_2, estimates, sds = np.array(
        [[float(row[column]) for row in parameters] for column in columns]
    )
    x, y = (np.array([float(point[axis]) for point in points]) for axis in "xy")
    return CertifiedSet(
        name, residuals["difficulty"], CURVES[name], x, y,
        tuple(row["parameter"] for row in parameters), np.stack([starts_1, starts_2]), estimates,
        sds, float(residuals["sum_of_squares"]), float(residuals["standard_deviation"]),
    )  # fmt: skip


def tasks_of(names: Sequence[str]) -> list[Task]:
    """Return a task for each set; the row of its last parameter shows that it is done."""
    return [{"set": name, "parameter": certified(name).names[-1]} for name in names]
