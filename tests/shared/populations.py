"""Populations whose answer is known: specimens with normal posteriors on the logarithm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.population.coordinate import Coordinate
from deabayes.population.member import Member
from deabayes.population.model import PopulationModel
from deabayes.prior.distributions import Distribution, LogNormal
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter

MEDIANS, SIGMAS = (1e4, 2.0), (1.0, 0.7)
DRAWS = 8000


def parameter(name: str, prior: Distribution, unit: str = "Pa", **more: str) -> Parameter:
    return Parameter(name, name, unit, f"about {name}", prior, "test", **more)  # type: ignore[arg-type]


def prior_of_two() -> Prior:
    pairs = zip("ab", MEDIANS, SIGMAS, strict=True)
    return Prior([parameter(name, LogNormal(m, s)) for name, m, s in pairs])


@dataclass(frozen=True)
class World:
    """Readings y (S, 2) with standard deviations sd (S, 2) of log theta, and their population."""

    y: FloatArray
    sd: FloatArray
    model: PopulationModel

    def log_likelihood(self, centres: FloatArray, spreads: FloatArray) -> FloatArray:
        """sum_k log N(y_k; m_k, sd_k^2 + s_k^2) of every specimen, (W, S)."""
        variance = self.sd[None] ** 2 + spreads[:, None] ** 2
        squares = (self.y[None] - centres[:, None]) ** 2 / variance
        return np.asarray(-0.5 * (squares + np.log(2 * np.pi * variance)).sum(axis=2))


def world(mean: FloatArray, spread: FloatArray, sd: FloatArray, rng: np.random.Generator) -> World:
    """Specimens drawn from a population and fitted each under the prior of `prior_of_two`.

    A normal reading y of log theta and the normal prior of log theta make a normal posterior,
    which is drawn from.
    """
    prior = prior_of_two()
    coordinate = Coordinate.of(prior.parameters)
    y = mean + spread * rng.standard_normal(sd.shape) + sd * rng.standard_normal(sd.shape)
    centre, width = np.log(MEDIANS), np.array(SIGMAS)
    members = []
    for index, (reading, error) in enumerate(zip(y, sd, strict=True)):
        precision = error**-2 + width**-2
        middle = (reading * error**-2 + centre * width**-2) / precision
        phi = middle + rng.standard_normal((DRAWS, 2)) / np.sqrt(precision)
        theta = coordinate.inverse(phi)
        members.append(Member.of(f"strip_{index}", theta, prior, coordinate, DRAWS))
    return World(y, sd, PopulationModel.of(coordinate, members))
