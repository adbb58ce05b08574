"""Evidence of one candidate: bridge sampling, highest likelihood, and records left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.problem import problem_of
from deabayes.sampling.peaks import climb
from deabayes.sampling.problem import LogDensity, Split, Target
from deabayes.sampling.progress import Progress
from deabayes.sampling.proposal import fit
from deabayes.sampling.warm_up import FOR_EVIDENCE, warm_up

REACH, BEYOND = 6.0, 3.0
"""The likelihood's maximum is searched within `REACH` prior standard deviations, or within `BEYOND`
of the draws where these lie further out."""
DRAWS, CLIMBS, MOST_ITERATIONS, MOST_QUIET = 128, 8, 200, 20
"""Draws whose likelihood is computed, climbs to its maximum from the best of them, and most
iterations of a climb. A climb also ends after `MOST_QUIET` iterations in turn that gain almost
nothing: without the prior's density, ridges are long and flat."""
POPULATIONS, PARTICLES, LARGEST_ERROR = 4, 256, 0.5
"""For the warm-up without an experiment: number of populations, particles per population, and
largest standard error at which the log evidence is used."""


@dataclass(frozen=True)
class Evidence:
    """Log of the marginal likelihood, with its Monte Carlo error and independent estimates."""

    log_evidence: float
    mcse: float
    estimates: tuple[float, ...]


def bridge_log_ratio(
    at_posterior: FloatArray, at_proposal: FloatArray, effective: float, iterations: int = 1000
) -> float:
    r"""Log of the normalising constant by the optimal bridge of Meng & Wong (1996).

    Parameters
    ----------
    at_posterior : (N1,) log target - log proposal at draws from the target.
    at_proposal : (N2,) log target - log proposal at draws from the proposal.
    effective : effective number of independent draws among the N1.

    Notes
    -----
    Iterates r <- mean_2[e^l / (s1 e^l + s2 r)] / mean_1[1 / (s1 e^l + s2 r)]
    with s1 = n_eff / (n_eff + N2), s2 = 1 - s1, in logarithms.
    """
    log_s1 = np.log(effective / (effective + at_proposal.size))
    log_s2 = np.log(at_proposal.size / (effective + at_proposal.size))
    log_ratio = float(np.median(at_posterior))
    for _ in range(iterations):
        top = at_proposal - np.logaddexp(log_s1 + at_proposal, log_s2 + log_ratio)
        bottom = -np.logaddexp(log_s1 + at_posterior, log_s2 + log_ratio)
        updated = float(
            logsumexp(top)
            - np.log(at_proposal.size)
            - logsumexp(bottom)
            + np.log(at_posterior.size)
        )
        if abs(updated - log_ratio) < 1e-10:
            return updated
        log_ratio = updated
    return log_ratio


def bridge_evidence(
    log_posterior: LogDensity,
    ensembles: FloatArray,
    effective: float,
    seed: np.random.SeedSequence,
    components: int = 4,
) -> Evidence:
    """Estimate the evidence from draws of independent ensembles by bridge sampling.

    The proposal is fitted to ensemble e, and the bridge uses the draws of ensemble e + 1.

    Parameters
    ----------
    log_posterior : unnormalised log density over z (W, d).
    ensembles : (E, S, d) draws of independent ensembles in z.
    effective : effective number of draws per ensemble.
    """
    count, size, _ = ensembles.shape
    estimates = []
    for index, stream in enumerate(seed.spawn(count)):
        rng = np.random.default_rng(stream)
        proposal = fit(ensembles[index], components, rng)
        target = ensembles[(index + 1) % count]
        proposed = proposal.sample(rng, size)
        estimates.append(
            bridge_log_ratio(
                log_posterior(target) - proposal.log_density(target),
                log_posterior(proposed) - proposal.log_density(proposed),
                min(effective, size),
            )
        )
    log_evidence = float(logsumexp(estimates) - np.log(count))
    return Evidence(
        log_evidence, float(np.std(estimates, ddof=1) / np.sqrt(count)), tuple(estimates)
    )


def leave_one_experiment_out(
    target: LogPosterior, log_evidence: float, z: FloatArray, seed: np.random.SeedSequence
) -> dict[str, float]:
    """log p(y_e | all other records) of each calibrated experiment; a gain goes with its phase.

    The value is the log evidence of all records minus the log evidence of the other records. A
    warm-up to the posterior of the other records gives the second evidence, to about a nat.
    (Carrying draws of the full posterior there gave a value seven nats too high for a membrane's
    step of 4 kV.) The value is NaN if the populations of the warm-up do not agree. The result is
    empty for a single experiment.

    Parameters
    ----------
    log_evidence : log evidence of all records.
    z : (N, d) draws of the posterior of all records, from which climbs start.
    """
    rows = list(dict.fromkeys(record.experiment.row for record in target.records))
    if len(rows) == 1:
        return {}
    gains = {}
    for row, stream in zip(rows, seed.spawn(len(rows)), strict=True):
        others = tuple(r for r in target.records if r.experiment.row != row)
        rest = _warmed_up_evidence(replace(target, records=others), z, stream)
        gains[row] = log_evidence - rest
    return gains


def _warmed_up_evidence(
    target: LogPosterior, similar: FloatArray, seed: np.random.SeedSequence
) -> float:
    """Estimate the log evidence by the tempering of a warm-up.

    If the problem has a rough solution, tempering uses the rough likelihood. The exact evidence
    is then the rough evidence times the mean of likelihood / rough likelihood over the rough
    posterior.
    """
    problem = problem_of(target)
    used = problem.rough or problem
    density, shape = Target(used.log_likelihood, used.split), (POPULATIONS, PARTICLES)
    populations = warm_up(used, density, shape, seed, Progress(), similar, FOR_EVIDENCE)
    estimates = populations.log_evidence
    if used is not problem:
        z = populations.particles.reshape(-1, problem.dimension)
        ratios = problem.log_likelihood(z) - used.log_likelihood(z)
        ratios = np.where(np.isfinite(ratios), ratios, -np.inf).reshape(shape)
        estimates = estimates + logsumexp(ratios, axis=1) - np.log(PARTICLES)
    error = np.std(estimates, ddof=1) / np.sqrt(POPULATIONS)
    if not error <= LARGEST_ERROR:
        return float("nan")
    return float(logsumexp(estimates) - np.log(POPULATIONS))


def maximum_log_likelihood(split: Callable[[FloatArray], Split], draws: FloatArray) -> float:
    """Find the highest log-likelihood by climbing from the best of some draws z (S, d).

    The prior's bounds limit the climb, but its density does not count.

    Parameters
    ----------
    split : z (W, d) -> the log-likelihood by points.
    """
    some = draws[np.linspace(0, len(draws) - 1, min(DRAWS, len(draws))).astype(int)]
    starts = some[np.argsort(-split(some).total)[:CLIMBS]]
    reach = np.maximum(REACH, np.abs(starts).max(axis=0) + BEYOND)

    def within(z: FloatArray) -> Split:
        return split(np.clip(z, -reach, reach))

    target = Target(lambda z: within(z).total, within, prior=0.0)
    identity = np.tile(np.eye(starts.shape[1]), (len(starts), 1, 1))
    return float(climb(target, starts, identity, MOST_ITERATIONS, quiet=MOST_QUIET).value.max())
