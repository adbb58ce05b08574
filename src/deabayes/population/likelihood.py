"""What one specimen's records say of its parameters, as a mixture of normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.cloud import systematic

MOST_COMPONENTS = 4
SPLIT_GAIN = 6.0
"""Of the BIC: strong evidence (Kass and Raftery 1995)."""
LARGEST_SHARE = 0.999
"""Of a component's variance in the prior's: equal ones say that the records are silent, and
noise of the draws must not make them say less than nothing."""
NOISE = 2.0
"""Standard errors of a variance by which it must be less than the prior's to say anything."""
WIDTHS = 1.0, 0.8, 0.6, 0.45, 0.35
"""Of a reference, in the prior's standard deviations: bounds that are 1.7 of those away would cut
off 40 % of the variance of one as wide, 4 % of one of 0.6."""
LEAST_KEPT = 0.95
"""Of a reference's variance in every direction: independent draws leave 0.98 of all of it."""


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


@dataclass(frozen=True)
class Reference:
    """A normal inside of a prior's support, by which posteriors are divided.

    Attributes
    ----------
    centre, factor : (d,) and (d, d): white = factor^-1 (phi - centre) is N(0, I) under it.
    shift, scale : the same once more, of prior draws in white that are weighted by the normal over
        the prior: what the support's bounds cut off is not there in posteriors either.
    """

    centre: FloatArray
    factor: FloatArray
    shift: FloatArray
    scale: FloatArray

    @classmethod
    def within(cls, prior_phi: FloatArray, log_prior: FloatArray) -> Reference:
        """As wide as the prior, or narrower until bounds cut off little (`LEAST_KEPT`).

        Parameters
        ----------
        prior_phi, log_prior : (N, d) draws of the prior and their log density, (N,).
        """
        centre = prior_phi.mean(axis=0)
        whole = _root(np.atleast_2d(np.cov(prior_phi, rowvar=False)))
        for width in WIDTHS:
            found = cls(centre, width * whole, np.zeros(len(centre)), np.eye(len(centre)))
            white, weights = found.weighted(prior_phi, log_prior)
            shift = weights @ white
            scale = _root(np.einsum("k,ki,kj->ij", weights, white - shift, white - shift))
            if np.linalg.svd(scale, compute_uv=False)[-1] ** 2 > LEAST_KEPT:
                break
        return cls(centre, width * whole, shift, scale)

    def weighted(self, phi: FloatArray, log_prior: FloatArray) -> tuple[FloatArray, FloatArray]:
        """White of draws (K, d), and their weights, the normal over the prior, (K,), of sum one."""
        white = _solved(self.factor, phi - self.centre)
        log_weights = -0.5 * np.sum(white**2, axis=1) - log_prior
        weights = np.exp(log_weights - log_weights.max())
        return _solved(self.scale, white - self.shift), weights / weights.sum()

    def back(self, means: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (J, d) and covariances (J, d, d) of normals in white, as those of phi."""
        root = self.factor @ self.scale
        centre = self.centre + self.factor @ self.shift
        return centre + means @ root.T, root @ covariances @ root.T


def fit(
    phi: FloatArray,
    log_prior: FloatArray,
    reference: Reference,
    independent: float,
    rng: np.random.Generator,
) -> Likelihood:
    r"""Divide a posterior by its prior.

    The prior is written as a normal times a rest, pi = N(p, P) r. The posterior's draws are
    weighted by 1 / r and a Gaussian mixture is fitted to them; each of its components N(mu_j,
    C_j), divided by N(p, P), is a normal again with B_j^{-1} = C_j^{-1} - P^{-1} and a_j =
    B_j (C_j^{-1} mu_j - P^{-1} p). Of normal and log-normal priors r is 1 and the division
    exact; where records are silent B_j grows without bound, instead of 1 / pi as a weight.

    Parameters
    ----------
    phi, log_prior : (K, d) and (K,), draws and their prior's log density as one of phi.
    reference : N(p, P).
    independent : how many independent draws the K are worth.
    """
    white, weights = reference.weighted(phi, log_prior)
    effective = independent / (len(phi) * np.sum(weights**2))
    even = white[systematic(weights, rng)]
    shares, means, covariances = _mixture(even, effective, rng)
    misfit = _misfit(even, shares, means, covariances)
    log_v, a, b = _divided(shares, means, covariances, 1.0 - NOISE * np.sqrt(2.0 / effective))
    return Likelihood(log_v, *reference.back(a, b), effective, misfit)


def _root(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.cholesky(covariance))


def _solved(factor: FloatArray, values: FloatArray) -> FloatArray:
    """factor^-1 of each row of values (K, d)."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(factor, values.T, lower=True).T)


def _divided(
    shares: FloatArray, means: FloatArray, covariances: FloatArray, silent: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """log v_j, a_j and B_j of a mixture over N(0, I).

    Parameters
    ----------
    silent : variances from which they are taken for the prior's.
    """
    values, vectors = np.linalg.eigh(covariances)
    values = np.where(values > min(silent, LARGEST_SHARE), LARGEST_SHARE, values)
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

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture

    centre = white.mean(axis=0)
    factor = _root(np.atleast_2d(np.cov(white, rowvar=False)))
    own = _solved(factor, white - centre)
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
