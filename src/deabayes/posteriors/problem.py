"""A log-posterior as the sampler is given it: functions of z, with what helps to sample it."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.noise.coordinates import noise_coordinates
from deabayes.posterior import LogPosterior
from deabayes.prior.coordinates import prior_coordinates
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.problem import Problem


def problem_of(target: LogPosterior) -> Problem:
    """The problem of a candidate: coordinates of prior, noise model and system, and its hops."""
    from deabayes.posteriors.summary import quantities

    prior, system = target.prior, target.system
    experiments = [record.experiment for record in target.records]
    own, free = prior_coordinates(prior)
    noise = noise_coordinates(target.noise, prior, _weights(target), free)
    parts = (*own, *noise, *system.coordinates(prior, experiments, free))
    return Problem(
        target.log_likelihood_of_normal,
        target.dimension,
        Coordinates(parts),
        tuple(system.hops(prior, experiments)),
        target.rough().log_likelihood_of_normal,
        lambda z: quantities(target, prior.to_parameters(z)),
    )


def _weights(target: LogPosterior) -> dict[str, FloatArray]:
    """Weights of white noise at all points of each noise group."""
    groups = dict.fromkeys(record.group for record in target.records)
    return {
        group: np.concatenate([r.weights for r in target.records if r.group == group])
        for group in groups
    }
