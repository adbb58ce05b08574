"""Draws as a transform of a standard normal vector: a mixture of normals, in warped coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.distributions.scores import FloatArray
from deabayes.faults import UserError
from deabayes.prior.normal_mixture import NormalMixture
from deabayes.warp import Warp, fit_warp

FEWEST_DRAWS_PER_PARAMETER = 10
SOUGHT_MISFIT = 0.03
"""From which one normal will not do; 8000 draws are 0.01 from themselves."""
COMPONENTS = (1, 2, 4, 8, 16)
"""Tried in turn where one normal does not describe the draws."""
LEAST_GAIN = 0.05
"""In the mean log density of draws left out [nat]: for less, no more components are taken. Where
many follow a bent ridge one after another its density dips between them, by a third with the 8
that bring the misfit of `ogden_2`'s film below 0.03; two in warped coordinates do as well."""
DRAWS_FOR_A_MARGINAL = 20_000


@dataclass(frozen=True)
class Transport:
    """x = W^-1(T(z)), z ~ N(0, I): T makes a mixture of normals, W straightens what bends.

    Parameters
    ----------
    mixture : of y = W(x).
    warp : W, a triangular polynomial map; None: y is x.
    """

    mixture: NormalMixture
    warp: Warp | None = None

    @property
    def bends(self) -> bool:
        """Whether it is no affine map."""
        return self.warp is not None or self.mixture.components > 1

    def colour(self, z: FloatArray) -> FloatArray:
        """x (W, k) of z (W, k)."""
        y = self.mixture.colour(z)
        return y if self.warp is None else self.warp.inverse(y)

    def whiten(self, x: FloatArray) -> FloatArray:
        """z (W, k) of x (W, k)."""
        return self.mixture.whiten(x if self.warp is None else self.warp.forward(x))

    def log_density(self, x: FloatArray) -> FloatArray:
        """log p(x), (W,), of x (W, k)."""
        if self.warp is None:
            return self.mixture.log_density(x)
        y, log_jacobian = self.warp.straighten(x)
        return self.mixture.log_density(y) + log_jacobian

    def marginal(self, columns: Sequence[int]) -> Transport:
        """That of some of the coordinates; of warped ones fitted to draws, always the same."""
        if self.warp is None:
            return Transport(self.mixture.marginal(columns))
        rng = np.random.default_rng(0)
        x = self.colour(rng.standard_normal((DRAWS_FOR_A_MARGINAL, self.mixture.means.shape[1])))
        return fit_transport(x[:, columns])

    def describe(self) -> str:
        """What it is, in words."""
        count = self.mixture.components
        kind = "multivariate normal" if count == 1 else f"mixture of {count} multivariate normals"
        return kind if self.warp is None else f"{kind} in straightened coordinates"


def fit_transport(x: FloatArray, names: Sequence[str] = ()) -> Transport:
    """Fit to draws x (S, k).

    One normal where it describes the draws (`SOUGHT_MISFIT`); else the mixture that describes
    draws left out best, straightened before or not. Of several that do nearly as well
    (`LEAST_GAIN`) the one of fewest components.

    Raises
    ------
    UserError : too few draws, or draws without spread in a direction.
    """
    size, dimension = x.shape
    if size < FEWEST_DRAWS_PER_PARAMETER * dimension:
        raise UserError(
            f"prior_from: {size} draws cannot carry the correlations of {dimension} "
            f"parameters; give at least {FEWEST_DRAWS_PER_PARAMETER * dimension}"
        )
    one = Transport(_normal(x, names))
    if distance_from_normal(one.whiten(x)) <= SOUGHT_MISFIT:
        return one
    components, warped = _best(x[: size // 2], x[size // 2 :])
    return _fitted(x, components, fit_warp(x, fine=True) if warped else None)


def _best(fitted: FloatArray, left_out: FloatArray) -> tuple[int, bool]:
    """How many components, and whether warped, describe draws left out well enough."""
    size, dimension = fitted.shape
    scores = {}
    for warp in (None, fit_warp(fitted, fine=True)):
        for components in COMPONENTS:
            if 2 * size >= FEWEST_DRAWS_PER_PARAMETER * dimension * components:
                found = _fitted(fitted, components, warp)
                scores[components, warp is not None] = found.log_density(left_out).mean()
    enough = max(scores.values()) - LEAST_GAIN
    return min(which for which, score in scores.items() if score >= enough)


def _fitted(x: FloatArray, components: int, warp: Warp | None) -> Transport:
    y = x if warp is None else warp.forward(x)
    normal = _normal(y)
    return Transport(_mixture(y, components, normal) if components > 1 else normal, warp)


def _normal(x: FloatArray, names: Sequence[str] = ()) -> NormalMixture:
    covariance = np.atleast_2d(np.cov(x, rowvar=False))
    try:
        factor = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise UserError(
            "prior_from: the draws do not vary in every direction of "
            f"{', '.join(names)}; is one of them fixed?"
        ) from None
    return NormalMixture(np.ones(1), x.mean(axis=0)[None], factor[None])


def _mixture(x: FloatArray, components: int, normal: NormalMixture) -> NormalMixture:
    """The likeliest mixture, by expectation and maximisation from k-means; always the same.

    Fitted to what `normal` whitens: the fit has a floor under variances, and a ridge may be thin.
    """
    from sklearn.mixture import GaussianMixture

    fitted = GaussianMixture(components, random_state=0, max_iter=500, tol=1e-4)
    fitted.fit(normal.whiten(x))
    factors = normal.factors[0] @ np.linalg.cholesky(fitted.covariances_)
    return NormalMixture(fitted.weights_, normal.colour(fitted.means_), factors)


def distance_from_normal(z: FloatArray) -> float:
    """How far draws z (S, k) are from N(0, I): the largest distance of distribution functions.

    Of each column from N(0, 1), and of the squared length from chi-squared with k degrees of
    freedom, which sees a bent or forked shape that no column shows.
    """
    from scipy.special import gammainc, ndtr

    squared_length = np.sum(z**2, axis=1, keepdims=True)
    columns = [np.sort(ndtr(z), axis=0), np.sort(gammainc(z.shape[1] / 2, squared_length / 2), 0)]
    uniform = np.concatenate(columns, axis=1)
    size = len(z)
    above = np.arange(1, size + 1)[:, None] / size - uniform
    return float(np.max(np.maximum(above, 1.0 / size - above)))
