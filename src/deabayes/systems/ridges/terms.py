"""Coordinates of Ogden terms, whose sum records show, and of a stretched Gent spring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.blocks import Parts
from deabayes.prior.coordinates import log_normals
from deabayes.prior.distributions import Uniform
from deabayes.prior.joint import Prior
from deabayes.prior.scores import log_normal_density
from deabayes.systems.ridges.film import FilmStress
from deabayes.systems.ridges.units import Shares, units_of
from deabayes.systems.springs.ogden import stress_of_one
from deabayes.systems.springs.stretched import StretchedSpring

Stresses = Shares | FilmStress

NEARLY_ZERO = 1e-9
"""Smallest magnitude of an exponent; for it, lambda^alpha is 1 + alpha ln lambda."""
HEIGHTS = 1.0, 0.92, 0.84
"""Heights h_k of the film's stresses over the height at the reference stretches. For the paper's
film, lambda_1 is 1, 0.85 and 0.72 times the reference stretch. Any factors between 1.1 and 0.7
give proposals that are as good."""
LEAST_SHARE, RARELY, LOOKED_AT = 0.005, 0.01, 2000
"""Records show a term if its share of the stress is below LEAST_SHARE in at most a fraction RARELY
of LOOKED_AT draws of the prior. If they show only one term, `FilmStress` has a hard boundary."""


@dataclass(frozen=True)
class Stretched:
    """The function ln(alpha / 2) - ln(lambda_1^alpha - lambda_3^alpha) of standardised exponents.

    Attributes
    ----------
    middle, sd : mean and standard deviation of the exponents' prior.
    logarithms : ln lambda_1 and ln lambda_3.
    """

    middle: float
    sd: float
    logarithms: tuple[float, float]

    def __call__(self, scores: FloatArray) -> FloatArray:
        exponents = self.middle + self.sd * scores
        exponents = np.where(np.abs(exponents) < NEARLY_ZERO, NEARLY_ZERO, exponents)
        return -np.log(np.abs(2.0 * stress_of_one(exponents, *self.logarithms) / exponents))


@dataclass(frozen=True)
class LogParts:
    """Coordinates that replace the scores of the parts of a total by the logs of the parts."""

    block: Parts

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) in place; return the log of the Jacobian, (W,)."""
        own = list(self.block.columns)
        z, parts = u[:, own], self.block.to_parameters(u[:, own])
        u[:, own] = np.log(parts)
        log_density = self.block.log_density(parts) + u[:, own].sum(axis=1)
        return np.asarray(log_normal_density(z).sum(axis=1) - log_density)

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`, in place."""
        own = list(self.block.columns)
        u[:, own] = self.block.to_normal(np.exp(u[:, own]))


def term_shares(
    joint: Prior, largest_stretches: tuple[float, float] | None, free: frozenset[int]
) -> list[LogParts | Stresses]:
    """Return coordinates for the terms of springs whose exponents have a uniform prior.

    If the prior is on the sum of the terms' stresses at one stretch, the coordinates use the
    parts of this stress. If each term has a log-normal share of the shear modulus, the coordinates
    use the stresses at the largest recorded stretch.

    Parameters
    ----------
    largest_stretches : see `System.largest_stretches`.
    free : columns of the prior that are not inherited.
    """
    found: list[LogParts | Stresses] = []
    for terms in units_of(joint):
        exponents, *companions = (tuple(row.tolist()) for row in terms.columns)
        prior = joint.parameters[exponents[0]].prior
        if len(companions) != 1 or not isinstance(prior, Uniform) or not free.issuperset(exponents):
            continue
        if parts := _parts(joint, companions[0], free):
            found += [LogParts(parts), _of_stresses(joint, exponents, companions[0])]
        elif shares := _shares(joint, largest_stretches, exponents, companions[0], free):
            found.append(shares)
    return found


def shown(scores: FloatArray) -> FloatArray:
    """Return zeros: records show the complete stress of a term."""
    return np.zeros_like(scores)


def _of_stresses(
    joint: Prior, exponents: tuple[int, ...], coefficients: tuple[int, ...]
) -> Stresses:
    """Coordinates of terms' stresses: `FilmStress` for two inherited terms, else `Shares`."""
    prior = joint.parameters[exponents[0]].prior
    stretches = joint.parameters[coefficients[0]].reference_stretches
    assert isinstance(prior, Uniform) and stretches is not None
    columns, logarithms = (exponents, coefficients), np.log(stretches)
    height = (logarithms[0] - logarithms[1]) / 2.0
    two_handed_on = len(exponents) == 2 and _handed_on(joint, *columns)
    if prior.lower >= 0.0 and two_handed_on and _both_seen(joint, *columns, logarithms):
        return FilmStress(*columns, *_moments(prior), height * np.array(HEIGHTS))
    ones = np.ones(len(exponents))
    return Shares(exponents, coefficients, 0.0 * ones, ones, shown, spread=True)


def _handed_on(joint: Prior, exponents: tuple[int, ...], coefficients: tuple[int, ...]) -> bool:
    """Whether an inherited posterior with a learned map contains all parameters of the terms."""
    names = {joint.names[column] for column in (*exponents, *coefficients)}
    return any(b.learned is not None and names <= set(b.names) for b in joint.inherited)


def _both_seen(
    joint: Prior,
    exponents: tuple[int, ...],
    coefficients: tuple[int, ...],
    logarithms: FloatArray,
) -> bool:
    """Whether the smallest share of the stress is rarely below LEAST_SHARE, in prior draws."""
    theta = joint.sample(np.random.default_rng(0), LOOKED_AT)
    stresses = theta[:, coefficients] * stress_of_one(theta[:, exponents], *logarithms)
    shares = stresses.min(axis=1) / stresses.sum(axis=1)
    return bool(np.quantile(shares, RARELY) > LEAST_SHARE)


def _moments(prior: Uniform) -> tuple[float, float]:
    """Mean and standard deviation of a uniform prior."""
    return (prior.lower + prior.upper) / 2.0, (prior.upper - prior.lower) / 12**0.5


def _parts(joint: Prior, coefficients: tuple[int, ...], free: frozenset[int]) -> Parts | None:
    """Return the prior block whose coefficients are parts of one stress, or None."""
    parameters = [joint.parameters[column] for column in coefficients]
    if not all(p.half_product_with and p.reference_stretches for p in parameters):
        return None
    for block in joint.blocks:
        if isinstance(block, Parts) and block.columns == coefficients:
            return block if free.issuperset(coefficients) else None
    return None


def _shares(
    joint: Prior,
    stretches: tuple[float, float] | None,
    exponents: tuple[int, ...],
    coefficients: tuple[int, ...],
    free: frozenset[int],
) -> Shares | None:
    """Return coordinates of terms with log-normal shares of the shear modulus, or None."""
    parameters = [joint.parameters[column] for column in coefficients]
    halves = all(p.half_product_with and not p.reference_stretches for p in parameters)
    normals = log_normals(joint, coefficients, free)
    prior = joint.parameters[exponents[0]].prior
    if stretches is None or not halves or len(normals) < len(coefficients):
        return None
    assert isinstance(prior, Uniform)
    medians, sigmas = np.array([(p.median, p.sigma) for p in normals]).T
    middle, sd = _moments(prior)
    logarithms = float(np.log(stretches[0])), float(np.log(stretches[1]))
    hidden = Stretched(middle, sd, logarithms)
    return Shares(exponents, coefficients, np.log(medians), sigmas, hidden)


@dataclass(frozen=True)
class GentPair:
    """Coordinates for modulus and limit of a Gent spring, as columns of z.

    ln mu = constant + modulus_slope z, ln J = limit_intercept + limit_slope z.
    """

    spring: StretchedSpring
    columns: tuple[int, int]
    modulus_slope: float
    limit_intercept: float
    limit_slope: float

    def straighten(self, u: FloatArray) -> float:
        """Replace the score of mu by the score of mu h(J), in place."""
        u[:, self.columns[0]] += self._log_secant(u)
        return 0.0

    def bend(self, u: FloatArray) -> None:
        """Undo `straighten`, in place."""
        u[:, self.columns[0]] -= self._log_secant(u)

    def _log_secant(self, z: FloatArray) -> FloatArray:
        """ln h(J) over the slope of ln mu, which is its value on the scale of the score of mu."""
        with np.errstate(over="ignore"):
            limit = np.exp(self.limit_intercept + self.limit_slope * z[:, self.columns[1]])
        return self.spring.log_secant(limit) / self.modulus_slope


def gent_pairs(
    prior: Prior, springs: Sequence[StretchedSpring], free: frozenset[int]
) -> list[GentPair]:
    """Return coordinates for each spring that the records stretch."""
    pairs: list[GentPair] = []
    for spring in springs:
        columns = [prior.names.index(name) for name in (spring.modulus, spring.limit)]
        normals = log_normals(prior, columns, free)
        if len(normals) == 2:
            modulus, limit = normals
            intercept = float(np.log(limit.median))
            places = columns[0], columns[1]
            pairs.append(GentPair(spring, places, modulus.sigma, intercept, limit.sigma))
    return pairs
