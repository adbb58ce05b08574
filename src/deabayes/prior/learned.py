"""Likelihood learned from draws of a posterior: their information beyond the default prior.

A mixture fitted to draws describes most of them well, but not a thin slice at their rim: there
the mixture is lumpy, and log densities are wrong by a nat. But a posterior is a known prior
times a likelihood. The likelihood is nearly normal in the features f(theta) that records
determine:

log p(theta) = log p_0(theta) + c + b f + f' A f / 2.

For an Ogden film, f is the film's stress at some stretches. Forces are linear in these stresses,
and depend on coefficients and exponents only through them. For other parameters, f is the scores.

A logistic regression on the monomials of f gives c, b and A. It separates the S draws of p from
S_q draws of the mixture q, whose density is known: the log odds that a draw belongs to p are
log p - log q + log(S / S_q) (Gutmann & Hyvarinen 2012, noise-contrastive estimation). As c is
fitted too, p is normalised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.parameter import Parameter
from deabayes.prior.scores import log_normal_density

LOG_STRETCHES = np.linspace(-0.3, 0.3, 5)
"""Log stretches relative to rest at which a film's stress is computed: 0.74 to 1.35 times."""
LEAST_SPREAD = 2e-3
"""Least standard deviation of a kept combination of standardised features; a combination that
varies less is redundant."""
RIDGE = 1e-3
"""Penalty on the squared coefficients; the features have unit variance."""
STEPS = 50
"""Largest number of steps of Newton's method; it usually takes five."""


@dataclass(frozen=True)
class Series:
    """Terms of an Ogden film, as columns of theta.

    Attributes
    ----------
    coefficients, exponents : columns of mu_i and of alpha_i.
    stretches : lambda_x and lambda_z at rest.
    """

    coefficients: tuple[int, ...]
    exponents: tuple[int, ...]
    stretches: tuple[float, float]

    def stresses(self, theta: FloatArray) -> FloatArray:
        """sum_i mu_i (lambda_x^alpha_i - lambda_z^alpha_i) [Pa] of theta (W, k), (W, 5)."""
        first, third = np.log(self.stretches)
        exponents = theta[:, self.exponents, None]
        stresses = np.expm1(exponents * (first + LOG_STRETCHES))
        stresses = stresses - np.expm1(exponents * (third - LOG_STRETCHES))
        return np.asarray(np.einsum("wi,wij->wj", theta[:, self.coefficients], stresses))


@dataclass(frozen=True)
class Shown:
    """Features that records determine: stresses of films, and scores of other parameters."""

    series: tuple[Series, ...]
    scores: tuple[int, ...]

    @classmethod
    def by(cls, parameters: Sequence[Parameter]) -> Shown:
        """Return the features of `parameters`, the columns of theta.

        An Ogden term counts as part of a film only if its exponent is among the parameters.
        """
        column = {p.name: k for k, p in enumerate(parameters)}
        films: dict[str, list[int]] = {}
        for k, p in enumerate(parameters):
            if p.part_of and p.reference_stretches and p.half_product_with in column:
                films.setdefault(p.part_of, []).append(k)
        series = []
        for terms in films.values():
            exponents = tuple(column[str(parameters[k].half_product_with)] for k in terms)
            stretches = parameters[terms[0]].reference_stretches
            assert stretches is not None
            series.append(Series(tuple(terms), exponents, stretches))
        in_series = {k for film in series for k in (*film.coefficients, *film.exponents)}
        return cls(tuple(series), tuple(k for k in column.values() if k not in in_series))

    def __call__(self, theta: FloatArray, z: FloatArray) -> FloatArray:
        """Features (W, F) of parameters theta (W, k) with scores z (W, k)."""
        return np.column_stack([*(s.stresses(theta) for s in self.series), z[:, self.scores]])


@dataclass(frozen=True)
class Learned:
    """A likelihood whose logarithm is quadratic in the features that records determine.

    Attributes
    ----------
    centre, directions : (F,) and (F, r): w = (f - centre) directions has mean 0 and unit
        covariance over the draws.
    coefficients : coefficients of 1, w_i, and w_i w_j with i <= j.
    """

    shown: Shown
    centre: FloatArray
    directions: FloatArray
    coefficients: FloatArray

    @classmethod
    def of(
        cls,
        shown: Shown,
        draws: tuple[FloatArray, FloatArray],
        others: tuple[FloatArray, FloatArray],
        log_others: tuple[FloatArray, FloatArray],
    ) -> Learned:
        """Learn the likelihood that best separates draws from draws of another density q.

        Parameters
        ----------
        draws, others : theta (S, k) and z (S, k) of the draws, and of the draws of q.
        log_others : log q(z) of both, (S,) each.
        """
        features = shown(*draws)
        centre = features.mean(axis=0)
        sd = features.std(axis=0)
        correlations = np.atleast_2d(np.corrcoef(features, rowvar=False))
        variances, vectors = np.linalg.eigh(correlations)
        varies = variances > LEAST_SPREAD**2
        directions = vectors[:, varies] / np.sqrt(variances[varies]) / sd[:, None]
        unweighted = cls(shown, centre, directions, np.zeros(0))
        terms = [unweighted._monomials(*drawn) for drawn in (draws, others)]
        known = [
            np.sum(log_normal_density(z), axis=1) - log_q
            for (_, z), log_q in zip((draws, others), log_others, strict=True)
        ]
        log_ratio = float(np.log(len(terms[0]) / len(terms[1])))
        coefficients = _told_apart(terms, known, log_ratio)
        linear = 1 + directions.shape[1]
        coefficients[linear:] = _bounded(coefficients[linear:], linear - 1)
        known = [
            k + t[:, linear:] @ coefficients[linear:] for k, t in zip(known, terms, strict=True)
        ]
        coefficients[:linear] = _told_apart([t[:, :linear] for t in terms], known, log_ratio)
        return cls(shown, centre, directions, coefficients)

    def __call__(self, theta: FloatArray, z: FloatArray) -> FloatArray:
        """log L, (W,); p_0 L is normalised."""
        return np.asarray(self._monomials(theta, z) @ self.coefficients)

    def directed(self, theta: FloatArray, z: FloatArray) -> FloatArray:
        """Features w (W, r), of unit covariance over the draws the likelihood was learned from."""
        return np.asarray((self.shown(theta, z) - self.centre) @ self.directions)

    def _monomials(self, theta: FloatArray, z: FloatArray) -> FloatArray:
        w = self.directed(theta, z)
        first, second = np.triu_indices(w.shape[1])
        return np.concatenate([np.ones((len(w), 1)), w, w[:, first] * w[:, second]], axis=1)


def _bounded(quadratic: FloatArray, size: int) -> FloatArray:
    """Coefficients of w_i w_j, i <= j, of the nearest form without positive curvature.

    Where draws add nothing to the prior, curvatures differ from zero only by chance. A form of
    positive curvature grows without limit and would exceed the decay of the prior far out.
    """
    first, second = np.triu_indices(size)
    form = np.zeros((size, size))
    form[first, second] = quadratic
    curvatures, axes = np.linalg.eigh(form + form.T)
    form = (axes * np.minimum(curvatures, 0.0)) @ axes.T
    return np.where(first == second, 0.5, 1.0) * form[first, second]


def _told_apart(terms: list[FloatArray], known: list[FloatArray], log_ratio: float) -> FloatArray:
    """Coefficients of a logistic regression with known offsets.

    Parameters
    ----------
    terms : monomials (S, m) of the draws and of the other draws.
    known : known part of the log odds of both, without `log_ratio`.
    """
    from scipy.optimize import minimize
    from scipy.special import expit, log_expit

    every = np.concatenate(terms)
    offsets = np.concatenate(known) + log_ratio
    usable = np.isfinite(every).all(axis=1) & np.isfinite(offsets)
    sign = np.repeat([1.0, -1.0], [len(rows) for rows in terms])[usable]
    every, offsets = every[usable], offsets[usable]

    def loss(b: FloatArray) -> float:
        return float(0.5 * RIDGE * b @ b - log_expit(sign * (offsets + every @ b)).sum())

    def gradient(b: FloatArray) -> FloatArray:
        wrong = sign * expit(-sign * (offsets + every @ b))
        return np.asarray(RIDGE * b - wrong @ every)

    def curvature(b: FloatArray) -> FloatArray:
        odds = expit(offsets + every @ b)
        return np.asarray((every.T * (odds * (1.0 - odds))) @ every + RIDGE * np.eye(b.size))

    start = np.linalg.lstsq(every[sign > 0], -offsets[sign > 0] + log_ratio, rcond=None)[0]
    options = {"maxiter": STEPS}
    minimum = minimize(
        loss, start, jac=gradient, hess=curvature, method="trust-exact", options=options
    )
    return np.asarray(minimum.x)


def distance_from_normal(z: FloatArray) -> float:
    """Largest distance between the distribution functions of draws z (S, k) and of N(0, I).

    Each column is compared with N(0, 1), and the squared length with chi-squared of k degrees of
    freedom. The squared length reveals a bent or forked shape that no column shows.
    """
    from scipy.special import gammainc, ndtr

    columns = _with_squared_length(z)
    columns[:, :-1] = ndtr(columns[:, :-1])
    columns[:, -1] = gammainc(z.shape[1] / 2, columns[:, -1] / 2)
    return _largest_gap(np.sort(columns, axis=0))


def distance(z: FloatArray, others: FloatArray, weights: FloatArray) -> float:
    """Distance of draws z (S, k) from weighted draws (S_o, k), as in `distance_from_normal`."""
    gaps = []
    for own, other in zip(_with_squared_length(z).T, _with_squared_length(others).T, strict=True):
        order = np.argsort(other)
        below = np.concatenate([[0.0], np.cumsum(weights[order])]) / weights.sum()
        at = np.searchsorted(other[order], np.sort(own), side="right")
        gaps.append(_largest_gap(below[at][:, None]))
    return max(gaps)


def _with_squared_length(z: FloatArray) -> FloatArray:
    return np.concatenate([z, np.sum(z**2, axis=1, keepdims=True)], axis=1)


def _largest_gap(probabilities: FloatArray) -> float:
    """Largest gap between distribution functions (S, n) at S ascending draws and the draws'."""
    size = len(probabilities)
    above = np.arange(1, size + 1)[:, None] / size - probabilities
    return float(np.max(np.maximum(above, 1.0 / size - above)))
