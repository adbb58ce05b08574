"""Tempered sequential Monte Carlo: from the prior to a posterior, or between posteriors.

A population is carried from a base density to base times increment along
base(z) * increment(z)^beta (Del Moral, Doucet and Jasra 2006, J. R. Stat. Soc. B 68, 411).
Its spread tends to be too narrow and its evidence too low: it starts ensembles and
re-weights posteriors, and nothing of it is published as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import log, pi

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.sampling.cloud import Cloud, LogDensity, Schedule
from deabayes.sampling.guide import NO_GUIDE, Guide
from deabayes.sampling.mixture import covariance_factor

Report = Callable[[float, int], None]


class EveryDrawFailed(UserError):
    """No particle has a finite likelihood: whoever knows the records says which."""


@dataclass(frozen=True)
class Population:
    """Equally weighted particles at the end of a schedule.

    Attributes
    ----------
    particles : (P, d); `broad` (P, d) are those of the last step before, which are
        over-dispersed with respect to the final density, and `early` (P, d) some of the
        first two thirds of the schedule.
    log_base, log_increment : (P,) at `particles`.
    log_evidence : estimate of the log of the ratio of normalising constants.
    betas : the schedule, from 0 to 1.
    """

    particles: FloatArray
    broad: FloatArray
    early: FloatArray
    log_base: FloatArray
    log_increment: FloatArray
    log_evidence: float
    betas: tuple[float, ...]
    rounds: int

    @property
    def log_density(self) -> FloatArray:
        """That of base times increment, (P,) at `particles`."""
        return self.log_base + self.log_increment

    @property
    def factor(self) -> FloatArray:
        """Cholesky factor of the particles' covariance, (d, d)."""
        return covariance_factor(np.cov(self.particles, rowvar=False))


def log_standard_normal(z: FloatArray) -> FloatArray:
    """Log density of N(0, I) at z (W, d): the prior of every model in its z coordinates."""
    return -0.5 * np.einsum("wd,wd->w", z, z) - 0.5 * z.shape[1] * log(2 * pi)


def from_prior(
    log_likelihood: LogDensity,
    dimension: int,
    particles: int,
    rng: np.random.Generator,
    schedule: Schedule | None = None,
    report: Report | None = None,
    guide: Guide = NO_GUIDE,
) -> Population:
    """Carry a population from the prior N(0, I) to the posterior; see `anneal`."""
    start = rng.standard_normal((particles, dimension))
    return anneal(start, log_standard_normal, log_likelihood, rng, schedule, report, guide)


def settle(
    particles: FloatArray,
    log_density: LogDensity,
    rng: np.random.Generator,
    schedule: Schedule | None = None,
    guide: Guide = NO_GUIDE,
) -> Population:
    """Move particles (P, d) that are already about the density of interest."""
    return anneal(particles, log_density, lambda z: np.zeros(len(z)), rng, schedule, guide=guide)


def anneal(
    particles: FloatArray,
    log_base: LogDensity,
    log_increment: LogDensity,
    rng: np.random.Generator,
    schedule: Schedule | None = None,
    report: Report | None = None,
    guide: Guide = NO_GUIDE,
) -> Population:
    """Carry particles (P, d), draws of base, to draws of base * increment.

    To leave an experiment out, base is the full posterior and the increment minus the
    experiment's log-likelihood; the way back swaps them. The estimated ratio of
    normalising constants is the product over the schedule of mean increments^(step).

    Parameters
    ----------
    log_base, log_increment : (W, d) -> (W,); NaN or -inf where a density is zero.
    report : called after every step with beta and the number of rounds so far.
    guide : what is known of the density; with a hop, base must hold the factor N(z; 0, I).

    Raises
    ------
    EveryDrawFailed : when the increment is zero at every particle.
    """
    schedule = schedule or Schedule()
    cloud = Cloud(particles.copy(), log_base, log_increment, rng, guide)
    betas, ratio, rounds = [0.0], 0.0, 0
    passed = [cloud.z.copy()]
    while betas[-1] < 1.0:
        step, log_mean = _next_step(cloud.increment, 1.0 - betas[-1], schedule.effective_share)
        betas.append(1.0 if step >= 1.0 - betas[-1] else betas[-1] + step)
        ratio += log_mean
        passed.append(cloud.z.copy())
        proposals = cloud.proposals(schedule)
        cloud.resample(step)
        rounds += cloud.forget(betas[-1], schedule, proposals)
        if report is not None:
            report(betas[-1], rounds)
    broad = passed[-1]
    early = rng.permutation(np.concatenate(passed[: -(-2 * len(passed) // 3)]))[: len(broad)]
    return Population(
        cloud.z, broad, early, cloud.base, cloud.increment, float(ratio), tuple(betas), rounds
    )


def _next_step(increment: FloatArray, remaining: float, share: float) -> tuple[float, float]:
    """The step in beta that leaves the wanted effective share, and the log mean weight."""
    finite = np.isfinite(increment)
    if not finite.any():
        raise EveryDrawFailed(
            "no particle has a finite likelihood: every draw of the prior failed; "
            "check the units of the records and the priors"
        )
    centred = increment[finite] - increment[finite].max()

    def effective(step: float) -> float:
        weights = np.exp(step * centred)
        return float(weights.sum() ** 2 / (weights**2).sum() / len(weights))

    low, high = 0.0, remaining
    if effective(remaining) < share:
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if effective(middle) > share else (low, middle)
    step = high
    log_mean = np.log(np.exp(step * centred).sum() / len(increment))
    return step, float(log_mean + step * increment[finite].max())
