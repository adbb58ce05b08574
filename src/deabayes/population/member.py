"""One specimen of a population: its posterior, prior and likelihood."""

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
from deabayes.posteriors.storage import stacked
from deabayes.prior.joint import Prior
from deabayes.sampling.tempering import systematic

SILENT = 0.1
"""Contraction, 1 - var_posterior / var_prior, below which records may say nothing."""
DISTANCE = 1.36
"""Kolmogorov's: one in twenty of the distances of n draws' distribution from its law, times the
root of n, is larger."""
NORMAL = 0.02
"""The same of a prior's draws, about twice what 20 000 scatter by; 0.06 of a uniform."""


def telling(phi: FloatArray, prior_phi: FloatArray, independent: float) -> NDArray[np.bool_]:
    """Which of a specimen's parameters (d,) its records tell anything of.

    Not one of which the draws are as wide as the prior's, and distributed like them as far as
    their number can show. One with a normal prior always counts: dividing by it is exact, so that
    the little that many specimens tell adds up to what it is.

    Parameters
    ----------
    phi : (K, d), draws of the posterior, worth `independent` ones.
    prior_phi : (N, d), draws of the prior.
    """
    return np.array(
        [
            _normal(before)
            or _contraction(after, before) >= SILENT
            or _distance(after, before) > DISTANCE / np.sqrt(independent)
            for after, before in zip(phi.T, prior_phi.T, strict=True)
        ]
    )


def _normal(draws: FloatArray) -> bool:
    from scipy.special import ndtr

    ordered = np.sort((draws - draws.mean()) / draws.std())
    above = np.arange(1, len(draws) + 1) / len(draws)
    return bool(np.max(np.abs(above - ndtr(ordered))) < NORMAL)


def _contraction(after: FloatArray, before: FloatArray) -> float:
    """By half the distance of the 16 and 84 % quantiles: tails do not count."""
    new, old = (np.ptp(np.quantile(draws, [0.16, 0.84])) for draws in (after, before))
    return float(1.0 - (new / old) ** 2)


def _distance(after: FloatArray, before: FloatArray) -> float:
    """The largest of the two draws' distribution functions."""
    from scipy.stats import ks_2samp

    return float(ks_2samp(after, before).statistic)


MOST_COMPONENTS = 4
SPLIT_GAIN = 6.0
"""Of the BIC: strong evidence (Kass and Raftery 1995)."""
LARGEST_SHARE = 0.999
"""Of a component's variance in the prior's: equal ones say that the records are silent, and
noise of the draws must not make them say less than nothing."""


@dataclass(frozen=True)
class Likelihood:
    r"""p(y | phi) = sum_j v_j N(phi; a_j, B_j), up to a constant.

    Attributes
    ----------
    log_weights, means, covariances : (J,), (J, d), (J, d, d): log v_j, a_j, B_j.
    effective_draws : independent draws that the posterior's are worth once the prior is
        taken out.
    misfit : largest distance of distribution functions, over the parameters, between the draws
        and the mixture.
    """

    log_weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    effective_draws: float
    misfit: float

    @property
    def variances(self) -> FloatArray:
        """Of every parameter, (d,)."""
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
    r"""Divide a posterior by its prior.

    The prior is written as a normal times a rest, pi = N(p, P) r. The posterior's draws are
    weighted by 1 / r and a Gaussian mixture is fitted to them; each of its components N(mu_j,
    C_j), divided by N(p, P), is a normal again with B_j^{-1} = C_j^{-1} - P^{-1} and a_j =
    B_j (C_j^{-1} mu_j - P^{-1} p). Of normal and log-normal priors r is 1 and the division
    exact; where records are silent B_j grows without bound, instead of 1 / pi as a weight.

    Bounds and order of another prior cut off the normal's tails, in the draws too, so that they
    look narrower than it. Parameters of which nothing is told are therefore left flat.

    Parameters
    ----------
    phi, log_prior : (K, d) and (K,), draws and their prior's log density as one of phi.
    prior_phi : (N, d) draws of the prior.
    told : (d,), of which parameters the records say anything (`silence.telling`).
    independent : how many independent draws the K are worth.
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
    """Means about the prior's centre and covariances of all parameters: flat where not told."""
    widest = LARGEST_SHARE / (1.0 - LARGEST_SHARE)
    all_means = np.tile(centre, (len(means), 1))
    all_covariances = np.tile(np.diag(widest * np.diag(covariance)), (len(means), 1, 1))
    all_means[:, told] += means
    all_covariances[np.ix_(np.arange(len(means)), told, told)] = covariances
    return all_means, all_covariances


def _divided(
    shares: FloatArray, means: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """log v_j, a_j and B_j of a mixture over N(0, I)."""
    values, vectors = np.linalg.eigh(covariances)
    values = np.minimum(values, LARGEST_SHARE)
    wide = values / (1.0 - values)
    turned = np.einsum("jkl,jk->jl", vectors, means)
    found = turned / (1.0 - values)
    log_v = np.log(shares) + 0.5 * np.sum(found * turned - np.log1p(-values), axis=1)
    back = np.einsum("jkl,jl->jk", vectors, found)
    return log_v, back, np.einsum("jkl,jl,jml->jkm", vectors, wide, vectors)


def _mixture(
    white: FloatArray, effective: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shares, means and covariances of as many components as the draws clearly show.

    Judged on as many draws as they are worth: correlated ones would show too many. Fitted on the
    draws' own scale, since scikit-learn adds 1e-6 to every variance: on the prior's scale that is
    more than the width of draws that are a thousand times as narrow.
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
    """Largest distance of a column's empirical distribution from the mixture's."""
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
    """A specimen's draws, seen from the population.

    Attributes
    ----------
    phi : (K, d) draws of the population's parameters in its coordinate.
    log_prior : (K,) log density, as one of phi, of the prior that they were sampled under.
    prior : of the population's parameters; its mean and sd in phi are `prior_mean`, `prior_sd`.
    independent : how many independent draws the K are worth.
    told : (d,), of which parameters its records say anything.
    contraction : of every parameter, by its own records.
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
        """From draws theta (K, d) of the parameters whose prior `prior` is."""
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
    """The members of a population, and the coordinate of their parameters.

    Parameters
    ----------
    trees : their posterior files.
    priors : of all parameters of each, as they were sampled under.

    Raises
    ------
    UserError : a parameter is missing from a posterior, or its prior is not the one given.
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
    """The posterior has the parameters, and was sampled under this prior."""
    missing = [name for name in names if name not in tree["posterior"].data_vars]
    if missing:
        raise UserError(f"study {study}: its posterior has no {missing[0]}; fit it again")
    stored = stacked(tree["log_prior"], "log_prior")
    found = prior.log_density(_draws(tree, prior.names))
    if not np.allclose(found, stored, rtol=1e-6, atol=1e-4):
        raise UserError(
            f"study {study}: its posterior was sampled under another prior than its settings and "
            "`prior_from` give now; fit it again"
        )
