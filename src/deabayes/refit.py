"""Proposals refitted to the draws of the other ensembles, where that describes them better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deabayes.ensemble import Ensemble
from deabayes.experiment import FloatArray
from deabayes.proposal import Proposal, fit

COMPONENTS = 16
SAMPLE, TRIAL_SAMPLE, JUDGED_SAMPLE = 20000, 8000, 2000
LEFT_OUT = 5
"""Every so many walkers one is left out of a trial."""
TOO_FAR = 1.0
"""Of `divergence` above that of usual draws; fitted to where all runs were, it is 0.1 to 0.8."""


def better_proposal(
    own: Proposal, others: Sequence[Ensemble], rng: np.random.Generator
) -> Proposal:
    """A proposal fitted to the second halves of `others`, or `own` if that is better.

    A trial fitted to four fifths of their walkers is judged, as `own` is, by its `divergence`
    at draws of the walkers left out. Fitted to a few effective draws, or to walkers that
    sit still, a proposal with its many coefficients is worse than the one it would replace.
    """
    kept, left_out = _draws(others, left_out=False), _draws(others, left_out=True)
    trial = _fit(*kept, TRIAL_SAMPLE, rng)
    judged = _some(left_out[0], JUDGED_SAMPLE, rng)
    z, log_posterior = left_out[0][judged], left_out[1][judged]
    if not divergence(trial, z, log_posterior) < divergence(own, z, log_posterior):
        return own
    both = zip(kept, left_out, strict=True)
    draws, log_posterior = (np.concatenate(parts) for parts in both)
    return _fit(draws, log_posterior, SAMPLE, rng)


def leaves_out(own: Proposal, others: Sequence[Ensemble], rng: np.random.Generator) -> bool:
    """Whether other runs have been where `own` hardly ever proposes to go."""
    both = zip(*(_draws(others, left_out=which) for which in (False, True)), strict=True)
    draws, log_posterior = (np.concatenate(parts) for parts in both)
    judged = _some(draws, JUDGED_SAMPLE, rng)
    z, densities = draws[judged], log_posterior[judged]
    usual = 0.5 * float(np.median(densities - own.log_density(z)))
    return divergence(own, z, densities) - usual > TOO_FAR


def divergence(proposal: Proposal, z: FloatArray, log_posterior: FloatArray) -> float:
    r"""log of the mean of (p/q)^(1/2) at draws z (n, d) of p: half a Renyi divergence.

    Of order 3/2, of the target p from the proposal q, up to a constant of p. An independence
    sampler sits still for about p/q proposals where that is large, so what decides is the
    hundredth of the draws where p/q is e^20; a mean of log q would see 0.2 of it.
    """
    excess = 0.5 * (log_posterior - proposal.log_density(z))
    largest = float(excess.max())
    return largest + float(np.log(np.mean(np.exp(excess - largest))))


def _draws(others: Sequence[Ensemble], left_out: bool) -> tuple[FloatArray, FloatArray]:
    """Draws (n, d) and log-posterior (n,) of some walkers, second halves of the runs."""
    draws, log_posterior = [], []
    for each in others:
        chosen = (np.arange(each.chain.shape[1]) % LEFT_OUT == 0) == left_out
        half = len(each.chain) // 2
        draws.append(each.chain[half:, chosen].reshape(-1, each.chain.shape[2]))
        log_posterior.append(each.log_posterior[half:, chosen].ravel())
    return np.concatenate(draws), np.concatenate(log_posterior)


def _fit(
    draws: FloatArray, log_posterior: FloatArray, most: int, rng: np.random.Generator
) -> Proposal:
    chosen = _some(draws, most, rng)
    return fit(draws[chosen], COMPONENTS, rng, log_posterior[chosen], may_split=True, fine=True)


def _some(draws: FloatArray, most: int, rng: np.random.Generator) -> np.ndarray:
    return rng.choice(len(draws), min(most, len(draws)), replace=False)
