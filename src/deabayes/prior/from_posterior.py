"""A posterior as the prior of another study: a mixture of normals, or a learned likelihood.

The mixture of normals provides draws, and coordinates for the sampler. If it needs several
normals, and the default prior times a learned likelihood describes the draws better (see
`learned`), the density is the default prior times the learned likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.prior.learned import Learned, Shown, distance, distance_from_normal
from deabayes.prior.normal_mixture import NormalMixture
from deabayes.prior.scores import log_normal_density

FEWEST_DRAWS_PER_PARAMETER = 10
LARGEST_MISFIT = 0.05
"""Distance of distribution functions from which a prior made from draws is called approximate."""
SOUGHT_MISFIT = 0.03
"""Largest misfit accepted for one normal; 8000 draws are 0.01 from the density they come from."""
COMPONENTS = (2, 4, 8, 16)
"""Numbers of normals to try if one normal does not describe the draws."""
MIXTURES = 4
"""Number of mixtures with several components; the density is the mean of these mixtures."""
LEAST_GAIN = 0.05
"""Loss in the mean log density of left-out draws [nat] accepted for fewer components; least gain
by a learned likelihood. With too few components on a bent ridge, the density dips between them:
by a third with the 8 components that bring the misfit of `ogden_2`'s film below 0.03."""
OTHERS = 4
"""Draws of the mixture per draw of the posterior, to learn the likelihood from."""


class PriorFromPosterior(NamedTuple):
    """Draws of another posterior, to be used as a prior."""

    names: tuple[str, ...]
    draws: FloatArray
    """(S, k), in SI units."""

    def __repr__(self) -> str:
        return f"<Prior from {len(self.draws)} draws of {', '.join(self.names)}>"


@dataclass(frozen=True)
class PosteriorBlock:
    """A posterior in the default prior's standard-normal coordinate.

    Attributes
    ----------
    mixture : the density, unless `learned` is given.
    misfit : largest distance between distribution functions of the draws and of the density.
        Draws whitened by the mixture are compared with standard normals
        (`distance_from_normal`). With `learned`, scores and features of the draws are compared
        with those of weighted draws of the mixture.
    learned : likelihood; the density is then the default prior times this likelihood.
    """

    names: tuple[str, ...]
    mixture: NormalMixture
    misfit: float
    learned: Learned | None = None

    @classmethod
    def fit(
        cls,
        names: tuple[str, ...],
        z: FloatArray,
        shown: Shown | None = None,
        to_parameters: Callable[[FloatArray], FloatArray] | None = None,
    ) -> PosteriorBlock:
        """Fit to draws z (S, k) in the default coordinate.

        One normal is used if it describes the draws (`SOUGHT_MISFIT`). Otherwise the number of
        normals that describes left-out draws best is chosen. The default prior times a learned
        likelihood is used if it gives left-out draws a higher density (`LEAST_GAIN`) than a
        mixture of that many normals. Otherwise the mean of several such mixtures is used.

        Parameters
        ----------
        shown, to_parameters : features that records determine, and the parameters of scores z.
            Without an Ogden film no likelihood is learned: quadratic in scores, it would be one
            normal.

        Raises
        ------
        UserError : too few draws, or draws without spread.
        """
        size, dimension = z.shape
        if size < FEWEST_DRAWS_PER_PARAMETER * dimension:
            raise UserError(
                f"prior_from: {size} draws are too few for the correlations of {dimension} "
                f"parameters; give at least {FEWEST_DRAWS_PER_PARAMETER * dimension}"
            )
        normal = _normal(names, z)
        block = cls._of(names, normal, z)
        if block.misfit <= SOUGHT_MISFIT:
            return block
        components = _best_number(z, normal)
        if components == 1:
            return block
        if shown is not None and shown.series and to_parameters is not None:
            half = z[: size // 2]
            on_half = cls(names, _mixture(half, components, normal), block.misfit)
            on_half = on_half._learning(half, shown, to_parameters)
            rest = z[size // 2 :]
            if on_half.log_weights(to_parameters(rest), rest).mean() > LEAST_GAIN:
                mixture = _mixture(z, components, normal)
                return cls(names, mixture, block.misfit)._learning(z, shown, to_parameters)
        return cls._of(names, _mean_of_mixtures(z, components, normal), z)

    @classmethod
    def _of(cls, names: tuple[str, ...], mixture: NormalMixture, z: FloatArray) -> PosteriorBlock:
        return cls(names, mixture, distance_from_normal(mixture.whiten(z)))

    def _learning(
        self,
        z: FloatArray,
        shown: Shown,
        to_parameters: Callable[[FloatArray], FloatArray],
    ) -> PosteriorBlock:
        """Return this block with a likelihood learned from draws z (S, k)."""
        size, rng = OTHERS * len(z), np.random.default_rng(0)
        theta, drawn = to_parameters(z), self.mixture.sample(rng, size)
        others = to_parameters(drawn)
        log_own, log_others = self.mixture.log_density(z), self.mixture.log_density(drawn)
        learned = Learned.of(shown, (theta, z), (others, drawn), (log_own, log_others))
        block = replace(self, learned=learned)
        weights = np.exp(block.log_weights(others, drawn))
        seen = learned.directed(theta, z), learned.directed(others, drawn)
        return replace(block, misfit=max(distance(z, drawn, weights), distance(*seen, weights)))

    def of(self, names: Sequence[str]) -> PosteriorBlock | None:
        """Marginal distribution of the parameters in `names`; None if the block has none of them.

        For a part of the parameters it is the marginal of the mixture, because the marginal of a
        learned likelihood is not known.
        """
        kept = [k for k, name in enumerate(self.names) if name in names]
        if not kept:
            return None
        return replace(
            self,
            names=tuple(self.names[k] for k in kept),
            mixture=self.mixture.marginal(kept),
            learned=self.learned if len(kept) == len(self.names) else None,
        )

    @cached_property
    def base(self) -> NormalMixture:
        """The single normal to which N(0, I) is mapped, with the mixture's mean and covariance.

        The map of a single normal is linear, also where records pull parameters far out. Far out
        the quantiles of a mixture are those of one component, and between two components they
        jump, so that no z lies there.
        """
        return self.mixture if self.mixture.components == 1 else self.mixture.as_one()

    @property
    def is_base(self) -> bool:
        """Whether the density is exactly `base`, so that no correction is needed."""
        return self.learned is None and self.mixture.components == 1

    def log_density_ratio(self, theta: FloatArray, z_default: FloatArray) -> FloatArray:
        """log p(z_default) - log N(z_default; 0, I), (W,)."""
        if self.learned is not None:
            return self.learned(theta, z_default)
        default = np.sum(log_normal_density(z_default), axis=1)
        return self.mixture.log_density(z_default) - default

    def log_correction(self, theta: FloatArray, z_default: FloatArray) -> FloatArray:
        """log p(z_default) - log q(z_default), (W,), where q is the single normal `base`."""
        return self._log_over(self.base, theta, z_default)

    def log_weights(self, theta: FloatArray, z_default: FloatArray) -> FloatArray:
        """log p(z_default) - log q(z_default), (W,), where q is the mixture."""
        return self._log_over(self.mixture, theta, z_default)

    def _log_over(self, q: NormalMixture, theta: FloatArray, z_default: FloatArray) -> FloatArray:
        if q is self.mixture and self.learned is None:
            return np.zeros(len(z_default))
        default = np.sum(log_normal_density(z_default), axis=1)
        log_density = self.log_density_ratio(theta, z_default) + default
        return np.asarray(log_density - q.log_density(z_default))

    def describe(self) -> str:
        """Describe the density in words, for tables."""
        if self.learned is not None:
            return "posterior of another study, a likelihood learned from its draws times the prior"
        count = self.mixture.components
        kind = "multivariate normal" if count == 1 else f"mixture of {count} multivariate normals"
        return f"posterior of another study, {kind} on the scores"


def _normal(names: tuple[str, ...], z: FloatArray) -> NormalMixture:
    covariance = np.atleast_2d(np.cov(z, rowvar=False))
    try:
        factor = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise UserError(
            f"prior_from: the draws of {', '.join(names)} do not vary in every direction; check "
            "whether one of these parameters is constant, or determined by the others"
        ) from None
    return NormalMixture(np.ones(1), z.mean(axis=0)[None], factor[None])


def _mixture(z: FloatArray, components: int, normal: NormalMixture) -> NormalMixture:
    """Fit a mixture by expectation-maximisation, started from k-means with a fixed seed.

    The draws are first whitened by `normal`, because the fit bounds variances from below and a
    ridge may be thin.
    """
    from sklearn.mixture import GaussianMixture

    fitted = GaussianMixture(components, random_state=0, max_iter=500, tol=1e-4)
    fitted.fit(normal.whiten(z))
    factors = normal.factors[0] @ np.linalg.cholesky(fitted.covariances_)
    return NormalMixture(fitted.weights_, normal.colour(fitted.means_), factors)


def _mean_of_mixtures(z: FloatArray, components: int, normal: NormalMixture) -> NormalMixture:
    """Mean of mixtures fitted to bootstrap samples, whose densities dip at different places."""
    again = np.random.default_rng(0).integers(len(z), size=(MIXTURES, len(z)))
    mixtures = [_mixture(z[drawn], components, normal) for drawn in again]
    return NormalMixture(
        np.concatenate([mixture.weights for mixture in mixtures]) / MIXTURES,
        np.concatenate([mixture.means for mixture in mixtures]),
        np.concatenate([mixture.factors for mixture in mixtures]),
    )


def _best_number(z: FloatArray, normal: NormalMixture) -> int:
    """Number of components that, fitted to half of the draws, describes the other half.

    It is the smallest number whose mean log density is within `LEAST_GAIN` of the best.
    """
    size, dimension = z.shape
    fitted, left_out = z[: size // 2], z[size // 2 :]
    scores = {1: float(normal.log_density(left_out).mean())}
    for components in COMPONENTS:
        if size >= FEWEST_DRAWS_PER_PARAMETER * dimension * components:
            mixture = _mixture(fitted, components, normal)
            scores[components] = float(mixture.log_density(left_out).mean())
    enough = max(scores.values()) - LEAST_GAIN
    return min(components for components, score in scores.items() if score >= enough)


LARGEST_SCORE = 30.0
"""Largest normal score; normal probabilities farther out cannot be distinguished."""


def check_scores(name: str, scores: FloatArray, prior: str) -> None:
    """Refuse draws of a parameter outside its default prior, or extremely far out in it.

    Parameters
    ----------
    scores : (S,) normal scores of the draws under the prior, NaN outside its support.
    prior : the prior in words.

    Raises
    ------
    UserError
    """
    outside = int(np.sum(~np.isfinite(scores)))
    far = int(np.sum(np.abs(scores) > LARGEST_SCORE))
    if not outside and not far:
        return
    place = "outside" if outside else f"more than {LARGEST_SCORE:.0f} standard deviations out in"
    raise UserError(
        f"prior_from: {outside or far} of {len(scores)} draws of {name} are {place} its "
        f"prior here ({prior}); widen this prior under `priors:`"
    )
