"""Mean and spread of a population, from the posteriors of its specimens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp, inf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.compiled import njit
from deabayes.population.coordinate import OF_LOGARITHM, Coordinate
from deabayes.population.member import Member
from deabayes.prior.distributions import Distribution, HalfNormal, LogNormal, Normal
from deabayes.prior.joint import Prior
from deabayes.prior.overrides import from_settings
from deabayes.prior.parameter import Parameter
from deabayes.sampling import engine
from deabayes.sampling.engine import Sampled
from deabayes.sampling.problem import Problem
from deabayes.sampling.progress import Progress
from deabayes.study import Sampling, Settings


@njit(cache=True, error_model="numpy")
def log_marginals(
    centres: FloatArray,
    spreads: FloatArray,
    log_weights: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    member: NDArray[np.intp],
    members: int,
) -> FloatArray:
    """log sum_j v_j N(m; a_j, B_j + diag(s^2)) of every member, (W, members), up to a constant.

    Parameters
    ----------
    centres, spreads : m and s, (W, d).
    log_weights, means, covariances : (J,), (J, d), (J, d, d): log v_j, a_j and B_j of the
        components of all members.
    member : (J,) index of the member to which a component belongs.
    members : number of members.
    """
    walkers, dimension = centres.shape
    result = np.full((walkers, members), -inf)
    factor = np.empty((dimension, dimension))
    solved = np.empty(dimension)
    for w in range(walkers):
        for j in range(log_weights.size):
            total = log_weights[j]
            for row in range(dimension):
                residual = centres[w, row] - means[j, row]
                for column in range(row + 1):
                    value = covariances[j, row, column]
                    if row == column:
                        value += spreads[w, row] ** 2
                    for k in range(column):
                        value -= factor[row, k] * factor[column, k]
                    if row == column:
                        factor[row, row] = sqrt(value)
                    else:
                        factor[row, column] = value / factor[column, column]
                        residual -= factor[row, column] * solved[column]
                solved[row] = residual / factor[row, row]
                total -= 0.5 * solved[row] ** 2 + log(factor[row, row])
            before = result[w, member[j]]
            high, low = max(before, total), min(before, total)
            result[w, member[j]] = high if low == -inf else high + log(1.0 + exp(low - high))
    return result


RELATIVE_SPREAD = 0.5
"""Scale of the default half-normal prior for the standard deviation of a logarithm. Specimens may
be equal, or differ by a factor of two or three."""
SPREAD_OF_PRIOR = 0.5
"""Scale of the default half-normal prior for the spread of a parameter that can change its sign,
in standard deviations of the members' prior."""
MEAN, SPREAD = "mean_", "spread_"


@dataclass(frozen=True)
class PopulationModel:
    r"""Posterior p(m, s | y_1..S) of mean and spread, for specimens with phi_i ~ N(m, diag(s^2)).

    Every specimen was fitted alone, under its own prior pi_i. If the population replaces this
    prior, the likelihood of m and s is

    p(y_i | m, s) ~ int N(phi; m, s^2) p(phi | y_i) / pi_i(phi) dphi.

    No forward model runs again: the posteriors of the first stage, divided by their priors, are
    the likelihoods of the second stage (Lunn, Barrett, Sweeting and Thompson 2013, J. R. Stat.
    Soc. C 62, 551). This ratio is written as a mixture of normals (see `member.fit`). The
    integral is then sum_j v_j N(m; a_j, B_j + diag(s^2)), exact and smooth down to s = 0. An
    average over draws would depend on the few draws within s of m instead.

    Parameters outside the population keep their prior, which is assumed to be independent of the
    population's parameters.
    """

    coordinate: Coordinate
    members: tuple[Member, ...]
    prior: Prior

    @classmethod
    def of(
        cls,
        coordinate: Coordinate,
        members: Sequence[Member],
        spread: Mapping[str, Settings] | None = None,
    ) -> PopulationModel:
        """Create the model; the prior of the means is the average of the members' priors.

        `spread` are the priors of the standard deviations between specimens, by parameter.
        """
        mean = np.mean([member.prior_mean for member in members], axis=0)
        sd = np.sqrt(np.mean([member.prior_sd**2 for member in members], axis=0))
        centres, spreads = [], []
        for p, logarithmic, unit, m, s in zip(
            coordinate.parameters,
            coordinate.logarithmic,
            coordinate.spread_units,
            mean.tolist(),
            sd.tolist(),
            strict=True,
        ):
            centres.append(_mean_parameter(p, logarithmic, m, s))
            spreads.append(_spread_parameter(p, unit, logarithmic, s, (spread or {}).get(p.name)))
        return cls(coordinate, tuple(members), Prior([*centres, *spreads]))

    @property
    def dimension(self) -> int:
        return len(self.prior.names)

    def split(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Split theta (W, 2 d) into m and s, each (W, d); theta holds the means as `inverse(m)`."""
        half = len(self.coordinate.names)
        return self.coordinate.forward(theta[:, :half]), np.ascontiguousarray(theta[:, half:])

    def log_likelihood(self, centres: FloatArray, spreads: FloatArray) -> FloatArray:
        """log p(y_i | m, s) of every member, (W, members), up to a constant per member."""
        return log_marginals(
            np.ascontiguousarray(centres), spreads, *self._components, len(self.members)
        )

    def log_likelihood_of_normal(self, z: FloatArray) -> FloatArray:
        """Log-likelihood of all members, (W,), at the standard-normal coordinate z (W, 2 d)."""
        return self.log_likelihood(*self.split(self.prior.to_parameters(z))).sum(axis=1)

    @cached_property
    def _components(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        likelihoods = [member.likelihood for member in self.members]
        counts = [len(likelihood.log_weights) for likelihood in likelihoods]
        return (
            np.concatenate([likelihood.log_weights for likelihood in likelihoods]),
            np.concatenate([likelihood.means for likelihood in likelihoods]),
            np.concatenate([likelihood.covariances for likelihood in likelihoods]),
            np.repeat(np.arange(len(likelihoods)), counts),
        )


def sample(
    model: PopulationModel,
    settings: Sampling,
    seed: np.random.SeedSequence,
    progress: bool = False,
) -> Sampled:
    """Sample mean and spread with the same sampler as a candidate's parameters."""
    problem = Problem(
        model.log_likelihood_of_normal,
        model.dimension,
        quantities=lambda z: dict(
            zip(model.prior.names, model.prior.to_parameters(z).T, strict=True)
        ),
    )
    return engine.sample(problem, settings, seed, progress=Progress(progress))


def _mean_parameter(p: Parameter, logarithmic: bool, mean: float, sd: float) -> Parameter:
    prior = LogNormal(float(np.exp(mean)), sd) if logarithmic else Normal(mean, sd)
    return Parameter(
        MEAN + p.name,
        rf"\mathrm{{mean}}\,{p.symbol}",
        p.unit,
        f"{p.description}: {'geometric mean' if logarithmic else 'mean'} of the population",
        prior,
        "the members' priors",
    )


def _spread_parameter(
    p: Parameter, unit: str, logarithmic: bool, prior_sd: float, settings: Settings | None
) -> Parameter:
    scale = RELATIVE_SPREAD if logarithmic else SPREAD_OF_PRIOR * prior_sd
    prior: Distribution = HalfNormal(scale)
    if settings is not None:
        prior = from_settings(settings, unit, f"spread.{p.name}")
    what = OF_LOGARITHM if logarithmic else "between specimens"
    return Parameter(
        SPREAD + p.name,
        rf"\mathrm{{spread}}\,{p.symbol}",
        unit,
        f"{p.description}: standard deviation {what}",
        prior,
        "default" if settings is None else "config",
    )
