"""One specimen of a population with posterior, prior and likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.population.checks import marginal
from deabayes.population.coordinate import Coordinate
from deabayes.posteriors.file import narrowing
from deabayes.posteriors.storage import stacked
from deabayes.prior.joint import Prior
from deabayes.sampling.tempering import systematic

SILENT = 0.1
"""Contraction, 1 - var_posterior / var_prior, below which records may give no information."""
DISTANCE = 1.36
"""95 % quantile of the Kolmogorov distance of n draws from their distribution, times sqrt(n)."""
NORMAL = 0.02
"""Kolmogorov distance from a normal below which a prior's draws count as normal. It is about twice
the scatter of 20 000 draws; a uniform prior has 0.06."""


def telling(phi: FloatArray, prior_phi: FloatArray, independent: float) -> NDArray[np.bool_]:
    """Find the parameters (d,) about which a specimen's records give information.

    A parameter is not informed if its posterior draws are about as wide as the prior's, and their
    distribution does not differ from the prior's beyond chance. A parameter with a normal prior
    always counts as informed: dividing by a normal prior is exact, so that even weak information
    from many specimens adds up correctly.

    Parameters
    ----------
    phi : (K, d) draws of the posterior.
    prior_phi : (N, d) draws of the prior.
    independent : effective sample size of the K draws.
    """
    return np.array(
        [
            _normal(before)
            or narrowing(after, before) >= SILENT
            or _distance(after, before) > DISTANCE / np.sqrt(independent)
            for after, before in zip(phi.T, prior_phi.T, strict=True)
        ]
    )


def _normal(draws: FloatArray) -> bool:
    from scipy.special import ndtr

    ordered = np.sort((draws - draws.mean()) / draws.std())
    above = np.arange(1, len(draws) + 1) / len(draws)
    return bool(np.max(np.abs(above - ndtr(ordered))) < NORMAL)


def _distance(after: FloatArray, before: FloatArray) -> float:
    """Largest distance between the distribution functions of two sets of draws."""
    from scipy.stats import ks_2samp

    return float(ks_2samp(after, before).statistic)


MOST_COMPONENTS = 4
SPLIT_GAIN = 6.0
"""Decrease of the BIC for one more component: strong evidence (Kass and Raftery 1995)."""
LARGEST_SHARE = 0.999
"""Largest ratio of a component's variance to the prior's. A ratio of 1 means that the records give
no information; noise of the draws must not make the ratio exceed 1."""


@dataclass(frozen=True)
class Likelihood:
    r"""p(y | phi) = sum_j v_j N(phi; a_j, B_j), up to a constant.

    Attributes
    ----------
    log_weights, means, covariances : (J,), (J, d), (J, d, d): log v_j, a_j, B_j.
    effective_draws : effective sample size of the posterior's draws after division by the prior.
    misfit : largest distance between the distribution functions of draws and mixture, over all
        parameters.
    """

    log_weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    effective_draws: float
    misfit: float

    @property
    def variances(self) -> FloatArray:
        """Variance of the mixture for every parameter, (d,)."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        weights /= weights.sum()
        centre = weights @ self.means
        within = np.diagonal(self.covariances, axis1=1, axis2=2)
        return np.asarray(weights @ (within + (self.means - centre) ** 2))


def fit(
    phi: FloatArray,
    log_prior: FloatArray,
    prior_phi: FloatArray,
    told: NDArray[np.bool_],
    independent: float,
    rng: np.random.Generator,
) -> Likelihood:
    r"""Divide a posterior by its prior to get the likelihood.

    The prior is written as a normal times a remainder, pi = N(p, P) r. The posterior's draws are
    weighted by 1 / r, and a Gaussian mixture is fitted to them. Every component N(mu_j, C_j),
    divided by N(p, P), is again a normal, with B_j^{-1} = C_j^{-1} - P^{-1} and
    a_j = B_j (C_j^{-1} mu_j - P^{-1} p). For normal and log-normal priors r is 1, and the
    division is exact. Where records give no information, B_j becomes very large; weights 1 / pi
    would become very large instead.

    Other priors have bounds or an order, which cut off the tails of the normal. The draws then
    look narrower than the normal even without information. Parameters without information
    therefore get a flat likelihood.

    Parameters
    ----------
    phi, log_prior : (K, d) and (K,), draws, and the log density of their prior in phi.
    prior_phi : (N, d) draws of the prior.
    told : (d,) whether the records give information about a parameter (`telling`).
    independent : effective sample size of the K draws.
    """
    from scipy.linalg import solve_triangular

    centre, covariance = prior_phi.mean(axis=0), np.atleast_2d(np.cov(prior_phi, rowvar=False))
    white = solve_triangular(np.linalg.cholesky(covariance), (phi - centre).T, lower=True).T
    log_rest = log_prior + 0.5 * np.sum(white**2, axis=1)
    weights = np.exp(-(log_rest - log_rest.min()))
    weights /= weights.sum()
    effective = independent / (len(phi) * np.sum(weights**2))
    if not told.any():
        nothing = _flat(np.zeros((1, 0)), np.zeros((1, 0, 0)), told, centre, covariance)
        return Likelihood(np.zeros(1), *nothing, effective, 0.0)
    factor = np.linalg.cholesky(covariance[np.ix_(told, told)])
    white = solve_triangular(factor, (phi - centre)[:, told].T, lower=True).T
    even = white[systematic(weights, rng)]
    shares, means, covariances = _mixture(even, effective, rng)
    misfit = _misfit(even, shares, means, covariances)
    log_v, a, b = _divided(shares, means, covariances)
    whole = _flat(a @ factor.T, factor @ b @ factor.T, told, centre, covariance)
    return Likelihood(log_v, *whole, effective, misfit)


def _flat(
    means: FloatArray,
    covariances: FloatArray,
    told: NDArray[np.bool_],
    centre: FloatArray,
    covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Means and covariances of all parameters, flat for those without information.

    `means` of the informed parameters are relative to `centre`.
    """
    widest = LARGEST_SHARE / (1.0 - LARGEST_SHARE)
    all_means = np.tile(centre, (len(means), 1))
    all_covariances = np.tile(np.diag(widest * np.diag(covariance)), (len(means), 1, 1))
    all_means[:, told] += means
    all_covariances[np.ix_(np.arange(len(means)), told, told)] = covariances
    return all_means, all_covariances


def _divided(
    shares: FloatArray, means: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """log v_j, a_j and B_j of a mixture divided by N(0, I)."""
    values, vectors = np.linalg.eigh(covariances)
    values = np.minimum(values, LARGEST_SHARE)
    wide = values / (1.0 - values)
    turned = np.einsum("jkl,jk->jl", vectors, means)
    means_without_prior = turned / (1.0 - values)
    log_v = np.log(shares) + 0.5 * np.sum(means_without_prior * turned - np.log1p(-values), axis=1)
    back = np.einsum("jkl,jl->jk", vectors, means_without_prior)
    return log_v, back, np.einsum("jkl,jl,jml->jkm", vectors, wide, vectors)


def _mixture(
    white: FloatArray, effective: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a mixture: shares, means and covariances of as many components as the draws justify.

    The number of components is chosen with `effective` draws, since correlated draws would
    suggest too many. The fit uses draws standardised by their own covariance, because
    scikit-learn adds 1e-6 to every variance. On the prior's scale, this would exceed the variance
    of draws a thousand times narrower than the prior.
    """
    import warnings

    from scipy.linalg import solve_triangular
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture

    centre = white.mean(axis=0)
    factor = np.linalg.cholesky(np.atleast_2d(np.cov(white, rowvar=False)))
    own = solve_triangular(factor, (white - centre).T, lower=True).T
    worth = rng.permutation(own)[: max(int(effective), 10 * white.shape[1])]
    best, lowest = None, np.inf
    for components in range(1, MOST_COMPONENTS + 1):
        seed = int(rng.integers(2**31))
        model = GaussianMixture(
            components, n_init=1 + (components > 1), max_iter=200, random_state=seed
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            model.fit(worth)
            if model.bic(worth) > lowest - SPLIT_GAIN:
                break
            best, lowest = model.fit(own), model.bic(worth)
    assert best is not None
    covariances = factor @ best.covariances_ @ factor.T
    return best.weights_, centre + best.means_ @ factor.T, covariances


def _misfit(
    draws: FloatArray, shares: FloatArray, means: FloatArray, covariances: FloatArray
) -> float:
    """Largest distance between a column's empirical distribution and the mixture's."""
    from scipy.special import ndtr

    ordered = np.sort(draws, axis=0)[:, None]
    sd = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    probability = np.einsum("j,kjd->kd", shares, ndtr((ordered - means) / sd))
    above = np.arange(1, len(draws) + 1)[:, None] / len(draws)
    return float(np.max(np.abs(above - probability)))


PRIOR_DRAWS = 20000
SEED = 20261122


@dataclass(frozen=True)
class Member:
    """One specimen as a member of a population.

    Attributes
    ----------
    phi : (K, d) draws of the population's parameters in the population's coordinate.
    log_prior : (K,) log density in phi of the prior under which the draws were sampled.
    prior : prior of the population's parameters; `prior_mean` and `prior_sd` are its mean and
        standard deviation in phi.
    independent : effective sample size of the K draws.
    told : (d,) whether the specimen's records give information about a parameter.
    contraction : contraction of every parameter by the specimen's records.
    """

    study: str
    phi: FloatArray
    log_prior: FloatArray
    prior: Prior
    prior_mean: FloatArray
    prior_sd: FloatArray
    independent: float
    likelihood: Likelihood
    told: NDArray[np.bool_]
    converged: bool = True
    provenance: str = "measured"
    contraction: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls, study: str, theta: FloatArray, prior: Prior, coordinate: Coordinate, independent: float
    ) -> Member:
        """Create a member from draws theta (K, d) of parameters with the prior `prior`."""
        rng = np.random.default_rng(SEED)
        phi, prior_phi = (
            coordinate.forward(draws) for draws in (theta, prior.sample(rng, PRIOR_DRAWS))
        )
        log_prior = prior.log_density(theta) + coordinate.log_derivative(theta)
        told = telling(phi, prior_phi, independent)
        likelihood = fit(phi, log_prior, prior_phi, told, independent, rng)
        moments = prior_phi.mean(axis=0), prior_phi.std(axis=0)
        return cls(study, phi, log_prior, prior, *moments, independent, likelihood, told)


def read_members(
    studies: Sequence[str],
    trees: Sequence[xr.DataTree],
    priors: Sequence[Prior],
    names: Sequence[str],
) -> tuple[Coordinate, list[Member]]:
    """Read the members of a population and the coordinate of their parameters.

    Parameters
    ----------
    trees : posterior files of the members.
    priors : prior of all parameters of every member, under which it was sampled.
    names : the population's parameters.

    Raises
    ------
    UserError : a parameter is missing from a posterior, or the posterior has another prior.
    """
    ordered = [p for p in priors[0].parameters if p.name in names]
    coordinate = Coordinate.of(ordered)
    members = []
    for study, tree, prior in zip(studies, trees, priors, strict=True):
        _check(study, tree, prior, coordinate.names)
        table = tree["summary"].to_dataset().to_dataframe().loc[list(coordinate.names)]
        theta = _draws(tree, coordinate.names)
        independent = float(min(table["ess_bulk"].min(), len(theta)))
        part = marginal(prior, coordinate.names)
        members.append(
            replace(
                Member.of(study, theta, part, coordinate, independent),
                converged=bool(tree["summary"]["converged"].values.all()),
                provenance=str(tree.attrs["provenance"]),
                contraction=table["contraction"].to_dict(),
            )
        )
    return coordinate, members


def _draws(tree: xr.DataTree, names: Sequence[str]) -> FloatArray:
    return np.stack([stacked(tree["posterior"], name) for name in names], axis=1)


def _check(study: str, tree: xr.DataTree, prior: Prior, names: Sequence[str]) -> None:
    """Check that a posterior has the parameters and was sampled under this prior."""
    missing = [name for name in names if name not in tree["posterior"].data_vars]
    if missing:
        raise UserError(f"study {study}: its posterior has no {missing[0]}; fit it again")
    stored = stacked(tree["log_prior"], "log_prior")
    log_prior = prior.log_density(_draws(tree, prior.names))
    if not np.allclose(log_prior, stored, rtol=1e-6, atol=1e-4):
        raise UserError(
            f"study {study}: its prior (settings or `prior_from`) has changed since its posterior "
            "was sampled; fit it again"
        )
