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


def better_proposal(
    own: Proposal, others: Sequence[Ensemble], rng: np.random.Generator
) -> Proposal:
    """A proposal fitted to the second halves of `others`, or `own` if that is better.

    A trial fitted to four fifths of their walkers is judged, as `own` is, by its mean log
    density at draws of the walkers left out. Fitted to a few effective draws, or to walkers that
    sit still, a proposal with its many coefficients is worse than the one it would replace.
    """
    kept, left_out = _draws(others, left_out=False), _draws(others, left_out=True)
    trial = _fit(*kept, TRIAL_SAMPLE, rng)
    judged = _some(left_out[0], JUDGED_SAMPLE, rng)
    z = left_out[0][judged]
    if not trial.log_density(z).mean() > own.log_density(z).mean():
        return own
    both = zip(kept, left_out, strict=True)
    draws, log_posterior = (np.concatenate(parts) for parts in both)
    return _fit(draws, log_posterior, SAMPLE, rng)


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
