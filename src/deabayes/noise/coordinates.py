r"""Coordinates of two noises that explain each other's variance.

White and correlated noise do where the correlation is shorter than the spacing of the record's
points. The posterior of their standard deviations is then a quarter of a circle: in logarithms
two ridges at a right angle, round the corner of which no polynomial goes. In
u_1 = ln sqrt(w s_white^2 + s_corr^2), u_2 = ln(s_corr / (s_white sqrt(w)))
it is the line of constant u_1 (w: mean weight of white noise, see `NoiseModel`). The Jacobian of
(u_1, u_2) by the two logarithms is 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.base import NoiseModel
from deabayes.prior.coordinates import log_normals
from deabayes.prior.joint import Prior


@dataclass(frozen=True)
class NoisePair:
    """White and correlated noise that add up: columns of z, and ln s = intercept + slope z.

    The intercept of white noise holds that of the root of w.
    """

    columns: tuple[int, int]
    intercepts: tuple[float, float]
    slopes: tuple[float, float]

    def straighten(self, u: FloatArray) -> float:
        """Put (u_1, u_2) in the places of both; log of the Jacobian."""
        white, correlated = self._logarithms(u)
        u[:, self.columns[0]] = 0.5 * np.logaddexp(2 * white, 2 * correlated)
        u[:, self.columns[1]] = correlated - white
        return float(np.log(self.slopes).sum())

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        total, ratio = u[:, self.columns[0]], u[:, self.columns[1]]
        white = total - 0.5 * np.logaddexp(0.0, 2 * ratio)
        for column, logarithm, intercept, slope in zip(
            self.columns, (white, white + ratio), self.intercepts, self.slopes, strict=True
        ):
            u[:, column] = (logarithm - intercept) / slope

    def _logarithms(self, z: FloatArray) -> list[FloatArray]:
        terms = zip(self.columns, self.intercepts, self.slopes, strict=True)
        return [intercept + slope * z[:, column] for column, intercept, slope in terms]


def noise_coordinates(
    noise: NoiseModel, prior: Prior, weights: Mapping[str, FloatArray], free: frozenset[int]
) -> list[NoisePair]:
    """One for each noise group of which both have log-normal priors of their own.

    Parameters
    ----------
    weights : of white noise at all points of a group's records.
    free : columns with priors of their own.
    """
    pairs: list[NoisePair] = []
    for group, each in weights.items():
        columns = [prior.names.index(f"{group}.{name}") for name in noise.adding]
        normals = log_normals(prior, columns, free)
        if len(normals) == 2:
            white, correlated = (float(np.log(p.median)) for p in normals)
            white += 0.5 * float(np.log(np.mean(each)))
            places, slopes = (columns[0], columns[1]), (normals[0].sigma, normals[1].sigma)
            pairs.append(NoisePair(places, (white, correlated), slopes))
    return pairs
