r"""Terms of an Ogden spring, of which records show the sum.

Where a record shows fewer terms than the spring has, one of them is invisible, at whatever
exponent, or shares what is seen with a neighbour: modes between which the exponents meet, as with
relaxation units (see `shares`). With v_i the stress of term i at the largest stretch on record,

u: ln sum_i v_i, ln(v_{i+1} / v_i); sum_i w_i alpha_i, alpha_{i+1} - alpha_i,
v_i = mu_i (lambda_1^alpha_i - lambda_3^alpha_i), w_i = v_i / sum_j v_j:

the sum and the mean exponent, which is the slope there of ln stress against ln stretch, are what a
record fixes. Exponents are counted in standard deviations of their prior. The Jacobian of u by
ln(mu_i alpha_i / 2), which carries the prior, and by alpha_i is 1.

What a record fixes next is the slope's own change, which is the variance of the exponents so
weighted: of two terms w_1 w_2 (alpha_2 - alpha_1)^2. Where it is fixed, the further the smaller
term's exponent, the smaller the term. For parts of a stress at given stretches, of which records
fix that much, its root takes the place of alpha_2 - alpha_1 (`Shares.spread`). In the ridge of a
film handed on, one term's share from 1 to 60 %, a cubic in ln(v_2 / v_1) leaves 0.025 of the root,
as a straight line does; of the exponents' difference 0.16, and a straight line 0.23.

Of two terms handed on that are both seen records fix more than that: see `film`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.distributions import Uniform
from deabayes.distributions.scores import log_normal_density
from deabayes.experiment import FloatArray
from deabayes.prior.blocks import Parts
from deabayes.prior.coordinates import log_normals
from deabayes.prior.joint import Prior
from deabayes.springs.ogden import stress_of_one
from deabayes.systems.ridges.film import FilmStress
from deabayes.systems.ridges.shares import Shares
from deabayes.systems.ridges.units import units_of

Stresses = Shares | FilmStress

NEARLY_ZERO = 1e-9
"""Of an exponent: lambda^alpha is 1 + alpha ln lambda."""
HEIGHTS = 1.0, 0.92, 0.84
"""Of the film's stresses, in those of the reference: 0.85 and 0.72 times as far for the paper's
film. Proposals are as good with any between 1.1 and 0.7."""
LEAST_SHARE, RARELY, LOOKED_AT = 0.005, 0.01, 2000
"""A term is seen whose share of the stress is rarely less, by so many draws of the prior. Where
one is not, coordinates that hold both have a wall."""


@dataclass(frozen=True)
class Stretched:
    """ln(alpha / 2) - ln(lambda_1^alpha - lambda_3^alpha) of standardised exponents.

    Attributes
    ----------
    middle, sd : of the exponents' prior.
    logarithms : of lambda_1 and of lambda_3.
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
    """Logarithms of parts of a total in place of their scores."""

    block: Parts

    def straighten(self, u: FloatArray) -> FloatArray:
        """Change the columns of u (W, d) and return the log of the Jacobian, (W,)."""
        own = list(self.block.columns)
        z, parts = u[:, own], self.block.to_parameters(u[:, own])
        u[:, own] = np.log(parts)
        log_density = self.block.log_density(parts) + u[:, own].sum(axis=1)
        return np.asarray(log_normal_density(z).sum(axis=1) - log_density)

    def bend(self, u: FloatArray) -> None:
        """Undo it."""
        own = list(self.block.columns)
        u[:, own] = self.block.to_normal(np.exp(u[:, own]))


def term_shares(
    joint: Prior, largest_stretches: tuple[float, float] | None, free: frozenset[int]
) -> list[LogParts | Stresses]:
    """Those of a spring's terms, of which the exponents are uniform.

    Where the prior is of all terms' stress at a stretch, of parts of it. Where each term has a
    log-normal share of the shear modulus, of stresses at the largest stretch on record.

    Parameters
    ----------
    largest_stretches : see `System.largest_stretches`.
    free : columns with priors of their own.
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
    """Nothing is hidden of a stress."""
    return np.zeros_like(scores)


def _of_stresses(
    joint: Prior, exponents: tuple[int, ...], coefficients: tuple[int, ...]
) -> Stresses:
    """Of terms' stresses at one stretch; of the film's at several, where it was handed on."""
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
    """Whether a posterior handed on is of a film with a ridge."""
    names = {joint.names[column] for column in (*exponents, *coefficients)}
    return any(b.learned is not None and names <= set(b.names) for b in joint.inherited)


def _both_seen(
    joint: Prior,
    exponents: tuple[int, ...],
    coefficients: tuple[int, ...],
    logarithms: FloatArray,
) -> bool:
    """Whether none of the terms handed on vanishes."""
    theta = joint.sample(np.random.default_rng(0), LOOKED_AT)
    stresses = theta[:, coefficients] * stress_of_one(theta[:, exponents], *logarithms)
    shares = stresses.min(axis=1) / stresses.sum(axis=1)
    return bool(np.quantile(shares, RARELY) > LEAST_SHARE)


def _moments(prior: Uniform) -> tuple[float, float]:
    """Mean and standard deviation."""
    return (prior.lower + prior.upper) / 2.0, (prior.upper - prior.lower) / 12**0.5


def _parts(joint: Prior, coefficients: tuple[int, ...], free: frozenset[int]) -> Parts | None:
    """The block of coefficients that are parts of one stress at given stretches."""
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
    """Those of terms with log-normal shares of the shear modulus."""
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
