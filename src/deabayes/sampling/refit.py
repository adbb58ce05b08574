"""Proposals refitted to the draws of all ensembles, where that describes them better."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.ensemble import Ensemble
from deabayes.sampling.proposal import Proposal
from deabayes.sampling.proposal_fit import fit

Draws = tuple[FloatArray, FloatArray]
"""z (n, d) and log-posterior (n,)."""
Chosen = Callable[[NDArray[np.intp]], NDArray[np.bool_]]
"""Which walkers, by their numbers."""

COMPONENTS = 16
SAMPLE, JUDGED_SAMPLE = 20000, 8000
LEFT_OUT = 5
"""Every so many walkers one is left out of a trial."""
TOO_FAR = 1.0
"""Of `divergence` above that of usual draws; fitted to where all runs were, it is 0.1 to 0.8."""
LOOKED_AT = 50
"""Steps of a run, to see how well its walkers are covered."""


def better_proposals(
    ensembles: Sequence[Ensemble],
    rng: np.random.Generator,
    coordinates: Coordinates,
    earlier: Sequence[Ensemble] = (),
) -> list[Proposal]:
    """For each ensemble a proposal fitted to the second halves of all, or its own if better.

    Runs before earlier refits are among them: what a proposal is fitted to need not be kept for
    the posterior, and its tails are as good as the independent draws are many.

    A trial fitted to four fifths of the walkers is judged, as their own ones are, by its
    `divergence` at draws of the walkers left out. Fitted to a few effective draws, or to walkers
    that sit still, a proposal with its many coefficients is worse than what it would replace.
    The walker that is covered worst is never left out, as nobody else may have been where it is
    caught; the trial has seen it, so only their own ones are judged at its draws, too.
    """
    caught = worst_covered(ensembles)
    group = 1 if caught % LEFT_OUT == 0 else 0
    left_out = _draws(ensembles, lambda walker: walker % LEFT_OUT == group)
    everything = [*earlier, *ensembles]
    kept = _draws(everything, lambda walker: walker % LEFT_OUT != group)
    trial = _fit(*kept, rng, coordinates)
    reached = divergence(trial, *_some(left_out, JUDGED_SAMPLE, rng))
    known = _draws(ensembles, lambda walker: (walker % LEFT_OUT == group) | (walker == caught))
    judged = _some(known, JUDGED_SAMPLE, rng)
    better = [reached < divergence(each.proposal, *judged) for each in ensembles]
    if not any(better):
        return [each.proposal for each in ensembles]
    found = _fit(*_draws(everything), rng, coordinates)
    chosen = zip(ensembles, better, strict=True)
    return [found if is_better else each.proposal for each, is_better in chosen]


def worst_covered(ensembles: Sequence[Ensemble]) -> int:
    """The walker of which the draws have the largest mean log of target over proposal."""
    worst, largest = 0, -np.inf
    for each in ensembles:
        half = len(each.chain) // 2
        steps = np.linspace(half, len(each.chain) - 1, min(LOOKED_AT, len(each.chain) - half))
        chain, densities = (a[steps.astype(int)] for a in (each.chain, each.log_posterior))
        proposed = each.proposal.log_density(chain.reshape(-1, chain.shape[2]))
        means = (densities - proposed.reshape(densities.shape)).mean(axis=0)
        if means.max() > largest:
            worst, largest = int(np.argmax(means)), float(means.max())
    return worst


def leave_out(ensembles: Sequence[Ensemble], rng: np.random.Generator) -> bool:
    """Whether any of them has been where a proposal of theirs hardly ever proposes to go."""
    judged = _some(_draws(ensembles), JUDGED_SAMPLE, rng)
    return any(_too_far(each.proposal, *judged) for each in ensembles)


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


def _draws(ensembles: Sequence[Ensemble], chosen: Chosen | None = None) -> Draws:
    """Of the walkers chosen by their numbers, the second halves of all runs."""
    draws, log_posterior = [], []
    for each in ensembles:
        numbers = np.arange(each.chain.shape[1])
        walkers = numbers >= 0 if chosen is None else chosen(numbers)
        half = len(each.chain) // 2
        draws.append(each.chain[half:, walkers].reshape(-1, each.chain.shape[2]))
        log_posterior.append(each.log_posterior[half:, walkers].ravel())
    return np.concatenate(draws), np.concatenate(log_posterior)


def _fit(
    draws: FloatArray, log_posterior: FloatArray, rng: np.random.Generator, coordinates: Coordinates
) -> Proposal:
    z, densities = _some((draws, log_posterior), SAMPLE, rng)
    return fit(z, COMPONENTS, rng, densities, may_split=True, fine=True, coordinates=coordinates)


def _some(draws: Draws, most: int, rng: np.random.Generator) -> Draws:
    z, log_posterior = draws
    picked = rng.choice(len(z), min(most, len(z)), replace=False)
    return z[picked], log_posterior[picked]
