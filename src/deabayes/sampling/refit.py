"""Proposals refitted to the draws of all ensembles, where that describes them better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.proposal import Proposal, fit

COMPONENTS = 16
SAMPLE, TRIAL_SAMPLE, JUDGED_SAMPLE = 20000, 8000, 2000
LEFT_OUT = 5
"""Every so many walkers one is left out of a trial."""
TOO_FAR = 1.0
"""Of `divergence` above that of usual draws; fitted to where all runs were, it is 0.1 to 0.8."""


def better_proposals(
    ensembles: Sequence[Ensemble], rng: np.random.Generator, coordinates: Coordinates
) -> list[Proposal]:
    """For each ensemble a proposal fitted to the second halves of all, or its own if better.

    A trial fitted to four fifths of the walkers is judged, as their own ones are, by its
    `divergence` at draws of the walkers left out. Fitted to a few effective draws, or to walkers
    that sit still, a proposal with its many coefficients is worse than what it would replace.
    """
    kept, left_out = _draws(ensembles, left_out=False), _draws(ensembles, left_out=True)
    trial = _fit(*kept, TRIAL_SAMPLE, rng, coordinates)
    judged = _some(left_out[0], JUDGED_SAMPLE, rng)
    z, log_posterior = left_out[0][judged], left_out[1][judged]
    reached = divergence(trial, z, log_posterior)
    better = [reached < divergence(each.proposal, z, log_posterior) for each in ensembles]
    if not any(better):
        return [each.proposal for each in ensembles]
    draws, densities = (np.concatenate(parts) for parts in zip(kept, left_out, strict=True))
    found = _fit(draws, densities, SAMPLE, rng, coordinates)
    chosen = zip(ensembles, better, strict=True)
    return [found if is_better else each.proposal for each, is_better in chosen]


def leave_out(ensembles: Sequence[Ensemble], rng: np.random.Generator) -> bool:
    """Whether any of them has been where a proposal of theirs hardly ever proposes to go."""
    halves = _draws(ensembles, left_out=False), _draws(ensembles, left_out=True)
    draws, log_posterior = (np.concatenate(parts) for parts in zip(*halves, strict=True))
    judged = _some(draws, JUDGED_SAMPLE, rng)
    z, densities = draws[judged], log_posterior[judged]
    return any(_too_far(each.proposal, z, densities) for each in ensembles)


def _too_far(own: Proposal, z: FloatArray, log_posterior: FloatArray) -> bool:
    usual = 0.5 * float(np.median(log_posterior - own.log_density(z)))
    return divergence(own, z, log_posterior) - usual > TOO_FAR


def divergence(proposal: Proposal, z: FloatArray, log_posterior: FloatArray) -> float:
    r"""log of the mean of (p/q)^(1/2) at draws z (n, d) of p: half a Renyi divergence.

    Of order 3/2, of the target p from the proposal q, up to a constant of p. An independence
    sampler sits still for about p/q proposals where that is large, so what decides is the
    hundredth of the draws where p/q is e^20; a mean of log q would see 0.2 of it.
    """
    excess = 0.5 * (log_posterior - proposal.log_density(z))
    largest = float(excess.max())
    return largest + float(np.log(np.mean(np.exp(excess - largest))))


def _draws(ensembles: Sequence[Ensemble], left_out: bool) -> tuple[FloatArray, FloatArray]:
    """Draws (n, d) and log-posterior (n,) of some walkers, second halves of the runs."""
    draws, log_posterior = [], []
    for each in ensembles:
        chosen = (np.arange(each.chain.shape[1]) % LEFT_OUT == 0) == left_out
        half = len(each.chain) // 2
        draws.append(each.chain[half:, chosen].reshape(-1, each.chain.shape[2]))
        log_posterior.append(each.log_posterior[half:, chosen].ravel())
    return np.concatenate(draws), np.concatenate(log_posterior)


def _fit(
    draws: FloatArray,
    log_posterior: FloatArray,
    most: int,
    rng: np.random.Generator,
    coordinates: Coordinates,
) -> Proposal:
    chosen = _some(draws, most, rng)
    return fit(
        draws[chosen],
        COMPONENTS,
        rng,
        log_posterior[chosen],
        may_split=True,
        fine=True,
        coordinates=coordinates,
    )


def _some(draws: FloatArray, most: int, rng: np.random.Generator) -> np.ndarray:
    return rng.choice(len(draws), min(most, len(draws)), replace=False)
