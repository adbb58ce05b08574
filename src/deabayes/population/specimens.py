"""Estimates of a population's specimens and of a new specimen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.population.member import SILENT, Member
from deabayes.population.model import PopulationModel
from deabayes.posteriors.sensitivity import UNRELIABLE_K_HAT, smoothed
from deabayes.prior.from_posterior import LARGEST_MISFIT

FEWEST_EFFECTIVE = 100.0
OUTLYING = 0.005
TAIL_DRAWS = 200
MOST_TRIES = 200
LARGEST_OUTSIDE = 0.01


@dataclass(frozen=True)
class Shrunken:
    """One specimen's posterior with the population as prior.

    Attributes
    ----------
    weights : (K,) weights of the specimen's own draws; they sum to one.
    effective_draws : effective sample size of the weighted draws.
    k_hat : Pareto shape of the weights.
    shrinkage : (d,) share of the population in the estimate: 0 if the specimen's own records
        alone determine the estimate, 1 if they give no information.
    tail_probability : (d,) two-sided tail probability of the specimen's own estimate in the
        distribution predicted from the other specimens.
    """

    weights: FloatArray
    effective_draws: float
    k_hat: float
    shrinkage: FloatArray
    tail_probability: FloatArray

    @property
    def reliable(self) -> bool:
        return self.k_hat <= UNRELIABLE_K_HAT and self.effective_draws >= FEWEST_EFFECTIVE


def shrink(
    model: PopulationModel,
    index: int,
    centres: FloatArray,
    spreads: FloatArray,
    others: tuple[FloatArray, FloatArray],
) -> Shrunken:
    r"""Weight a member's draws so that the population replaces its prior.

    p(phi_i | y) = p(phi_i | y_i) / pi_i(phi_i) E_{m, s | y} [N(phi_i; m, s^2) / p(y_i | m, s)],

    so that draw k of the member's own posterior has the weight

    w_k ~ sum_t N(phi_k; m_t, s_t^2) / (pi_i(phi_k) p(y_i | m_t, s_t)),

    Pareto-smoothed (Vehtari, Simpson, Gelman, Yao and Gabry 2024, JMLR 25(72)). For a normal
    likelihood of variance b the posterior mean is lambda m + (1 - lambda) y with the shrinkage
    lambda = b / (b + s^2) (Gelman et al. 2013, Bayesian Data Analysis, eq. 5.17), averaged here.

    Parameters
    ----------
    index : index of the member.
    centres, spreads : (T, d) draws of m and s.
    others : draws of m and s given all members except this one (see `without`).
    """
    member = model.members[index]
    evidence = model.log_likelihood(centres, spreads)[:, index]
    log_mean = np.full(len(member.phi), -np.inf)
    for m, s, log_y in zip(centres, spreads, evidence, strict=True):
        scaled = (member.phi - m) / s
        density = -0.5 * np.einsum("kd,kd->k", scaled, scaled) - np.log(s).sum() - log_y
        log_mean = np.logaddexp(log_mean, density)
    log_weights, k_hat = smoothed(log_mean - member.log_prior)
    weights = np.exp(log_weights)
    kish = 1.0 / np.sum(weights**2)
    variances = member.likelihood.variances
    return Shrunken(
        weights,
        kish * min(member.independent / len(weights), 1.0),
        k_hat,
        np.mean(variances / (variances + spreads**2), axis=0),
        tail_probability(member.phi, *others),
    )


def without(
    model: PopulationModel, index: int, z: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draws (T, d) of m and s given all members except one, from draws z (T, 2 d) given all.

    Tempering is needed; weights would not suffice. A specimen that does not belong to the
    population has widened all draws, so that draws as the other members alone would give them are
    missing.
    """
    from deabayes.sampling.problem import log_standard_normal
    from deabayes.sampling.tempering import temper

    def split(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        return model.split(model.prior.to_parameters(z))

    tempered = temper(
        z[None],
        lambda z: log_standard_normal(z) + model.log_likelihood_of_normal(z),
        lambda z: -model.log_likelihood(*split(z))[:, index],
        np.random.SeedSequence(int(rng.integers(2**63))),
    )
    return split(tempered.particles[0])


def tail_probability(phi: FloatArray, centres: FloatArray, spreads: FloatArray) -> FloatArray:
    r"""Two-sided tail probability of a specimen among the others, (d,): 2 min(P, 1 - P).

    P = E[Phi((phi_i - m) / s)] over the specimen's own posterior and the draws (T, d) of m and s
    given the others. P includes the specimen's own uncertainty, so that a poorly known specimen
    does not appear as an outlier.
    """
    from scipy.special import ndtr

    some = phi[np.linspace(0, len(phi) - 1, min(TAIL_DRAWS, len(phi))).astype(int)]
    below = ndtr((some[None] - centres[:, None]) / spreads[:, None]).mean(axis=1)
    share = below.mean(axis=0)
    return np.asarray(2.0 * np.minimum(share, 1.0 - share))


def new_specimens(
    model: PopulationModel, centres: FloatArray, spreads: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """Draw theta (W, d) of one new specimen for every (m, s); also return the rejected share.

    A draw that no member's prior allows (time constants out of order, beyond a bound) is repeated.
    If it still fails after `MOST_TRIES` tries, another draw's theta replaces it. The rejected
    share counts the first try.

    Raises
    ------
    UserError : more than half of the draws are still not allowed after all tries.
    """
    theta = np.empty_like(centres)
    left = np.arange(len(centres))
    outside = 1.0
    for attempt in range(MOST_TRIES):
        phi = centres[left] + spreads[left] * rng.standard_normal((left.size, centres.shape[1]))
        theta[left] = model.coordinate.inverse(phi)
        left = left[~_allowed(model.members, theta[left])]
        if attempt == 0:
            outside = left.size / len(centres)
        if not left.size:
            return theta, outside
    if left.size > 0.5 * len(centres):
        raise UserError(
            f"{left.size} of {len(centres)} draws of a new specimen lie outside of all members' "
            "priors; give the spread a narrower prior, or widen the members'"
        )
    inside = np.setdiff1d(np.arange(len(centres)), left)
    theta[left] = theta[rng.choice(inside, left.size)]
    return theta, outside


def warnings_of(model: PopulationModel, shrunken: list[Shrunken], outside: float) -> list[str]:
    """Return warnings about the members and the new specimen, in sentences."""
    warnings = []
    for member, estimate in zip(model.members, shrunken, strict=True):
        if not estimate.reliable:
            warnings.append(
                f"{member.study}: few of its own draws agree with the population "
                f"({estimate.effective_draws:.0f} effective draws, k-hat {estimate.k_hat:.2f}); do "
                "not use its shrunken estimate"
            )
        pairs = zip(model.coordinate.names, estimate.tail_probability, strict=True)
        out = [f"{name} ({p:.1g})" for name, p in pairs if p < OUTLYING]
        if out:
            warnings.append(
                f"{member.study}: it differs from the other specimens in {', '.join(out)} (tail "
                "probability); check whether it belongs to this population"
            )
        if member.likelihood.misfit > LARGEST_MISFIT:
            warnings.append(
                f"{member.study}: its posterior is not well described by normals (largest "
                f"distance {member.likelihood.misfit:.2f}); mean and spread are approximate"
            )
        warnings += _little_told(member, model.coordinate.names)
    if outside > LARGEST_OUTSIDE:
        warnings.append(
            f"new specimen: {outside:.0%} of the draws lay outside of the members' priors (order "
            "or bounds of parameters) and were drawn again; mean and spread ignore this"
        )
    return warnings


def _little_told(member: Member, names: tuple[str, ...]) -> list[str]:
    """Return warnings about parameters on which a member's records give little information."""
    silent = [name for name, told in zip(names, member.told, strict=True) if not told]
    faint = [n for n, c in member.contraction.items() if c < SILENT and n not in silent]
    warnings = []
    if silent:
        warnings.append(
            f"{member.study}: its records do not inform {', '.join(silent)}; there, mean, spread "
            "and its own estimate come from the other specimens"
        )
    if faint:
        warnings.append(
            f"{member.study}: its records hardly inform {', '.join(faint)}; bounds and order of "
            "its prior are removed only approximately, so mean and spread may look better known "
            "than they are"
        )
    return warnings


def _allowed(members: tuple[Member, ...], theta: FloatArray) -> NDArray[np.bool_]:
    priors = {id(member.prior): member.prior for member in members}.values()
    return np.any([np.isfinite(prior.log_density(theta)) for prior in priors], axis=0)
