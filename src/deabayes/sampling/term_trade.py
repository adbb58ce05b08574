r"""A proposal by which two neighbouring Ogden terms trade places and shares of their stress.

Where two exponents meet, their terms are one to any record: the gap between them, down to nothing,
and the share of either are free. In coordinates of moments (see `film_moments`) that is a cusp,
with b and a + O(b) for its width, as narrow as the gap; no difference of walkers is as small, and
what is fitted to draws falls ever farther below the density there. A walker stayed at a gap of
3e-4 for 27 000 steps (docs/sampler.md).

Of terms i and j = i + 1, with stresses v at the reference stretches and y = alpha coth(h alpha),

V = v_i + v_j, m = (v_i y_i + v_j y_j) / V, b = (q (1 - q))^(1/2) (y_j - y_i), q = v_j / V,

are fixed by records one after another. V and m are kept; ln b and x = ln q / (1 - q) move by a
normal step each: small b forgives any. With y_j - y_i = 2 b cosh(x / 2) the volume element is
d ln v_i d ln v_j dy_i dy_j = 2 (y_j - y_i) dV/V dm d ln b dx, so that (y_j' - y_i') / (y_j - y_i)
multiplies the ratio of densities in ln v and y (Tierney 1994, Annals of Statistics 22, 1701).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.joint import Prior
from deabayes.sampling.film_moments import FilmMoments, exponent_of, slope_of
from deabayes.sampling.mixture import RandomSource
from deabayes.sampling.proposed import weighed
from deabayes.springs.ogden import stress_of_one

STEPS = (0.0, 0.3, 3.0)
"""Standard deviations of the steps of ln b and of x, chosen for each walker."""


@dataclass(frozen=True)
class TermTrade:
    """Proposals z -> z' of a prior with Ogden terms, with the factor of their acceptance.

    Attributes
    ----------
    exponents, coefficients : columns of alpha_i, ascending, and of mu_i, (n,).
    logarithms : of lambda_1 and lambda_3 at which a term's stress is v.
    """

    prior: Prior
    exponents: tuple[int, ...]
    coefficients: tuple[int, ...]
    logarithms: tuple[float, float]

    @classmethod
    def of(cls, prior: Prior, film: FilmMoments) -> TermTrade:
        """That of a film's terms, by the columns of its coordinates."""
        stretches = prior.parameters[film.stresses[0]].reference_stretches
        assert stretches is not None
        first, third = np.log(stretches)
        return cls(prior, film.exponents, film.stresses, (float(first), float(third)))

    def __call__(self, z: FloatArray, random: RandomSource) -> tuple[FloatArray, FloatArray]:
        """Proposed z' (W, d), and the log of what L'N(z')/(L N(z)) is to be multiplied by, (W,).

        A proposal outside the prior's support is z itself with factor -inf.
        """
        theta = self.prior.to_parameters(z)
        first = random.choice(len(self.exponents) - 1, size=len(z))
        pair = np.stack([first, first + 1], axis=1)
        steps = [
            np.asarray(STEPS)[random.choice(len(STEPS), size=len(z))]
            * random.standard_normal(len(z))
            for _ in range(2)
        ]
        with np.errstate(all="ignore"):  # what is no film is outside the support
            proposed, factor = self._traded(theta, pair, *steps)
        return weighed(self.prior, z, theta, proposed, factor)

    def _traded(
        self, theta: FloatArray, pair: FloatArray, widening: FloatArray, turning: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """theta' and the log Jacobian, (W,), at the steps of ln b and x, (W,) each."""
        rows, height = (
            np.arange(len(theta))[:, None],
            0.5 * (self.logarithms[0] - self.logarithms[1]),
        )
        at = np.asarray(self.exponents)[pair], np.asarray(self.coefficients)[pair]
        exponents, coefficients = theta[rows, at[0]], theta[rows, at[1]]
        places, slopes = slope_of(exponents, height)
        stresses = coefficients * stress_of_one(exponents, *self.logarithms)
        total = stresses.sum(axis=1)
        share, gap = stresses[:, 1] / total, places[:, 1] - places[:, 0]
        middle = places[:, 0] + share * gap
        x = np.log(stresses[:, 1] / stresses[:, 0])
        widened = gap * np.exp(widening) * np.cosh(0.5 * (x + turning)) / np.cosh(0.5 * x)
        other = 1.0 / (1.0 + np.exp(-x - turning))
        moved = middle[:, None] + np.stack([-other * widened, (1.0 - other) * widened], axis=1)
        found = exponent_of(moved, height)
        parts = total[:, None] * np.stack([1.0 - other, other], axis=1)
        proposed = theta.copy()
        proposed[rows, at[0]] = found
        proposed[rows, at[1]] = parts / stress_of_one(found, *self.logarithms)
        ratios = proposed[rows, at[1]] / coefficients * slopes / slope_of(found, height)[1]
        return proposed, np.log(widened / gap) + np.log(np.abs(ratios)).sum(axis=1)
