"""Turn a log-posterior into a problem for the sampler: functions of z, and sampling hints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior, Record
from deabayes.noise.base import noise_coordinates
from deabayes.prior.coordinates import prior_coordinates
from deabayes.sampling.problem import Coordinates, Problem, Split
from deabayes.systems.base import Batch


def problem_of(target: LogPosterior) -> Problem:
    """Return a candidate's problem, with hops and coordinates of prior, noise model and system."""
    from deabayes.posteriors.file import quantities

    prior, system = target.prior, target.system
    experiments = [record.experiment for record in target.records]
    own, free = prior_coordinates(prior)
    noise = noise_coordinates(target.noise, prior, _noise_factors(target), free)
    parts = (*own, *noise, *system.coordinates(prior, experiments, free))
    exact = Problem(
        target.log_likelihood_of_normal,
        target.dimension,
        Coordinates(parts),
        tuple(system.hops(prior, experiments)),
        lambda z: split_log_likelihood(target, z),
        quantities=lambda z: quantities(target, prior.to_parameters(z)),
    )
    rough = target.rough()
    if rough is target:
        return exact
    return replace(
        exact,
        rough=replace(
            exact,
            log_likelihood=rough.log_likelihood_of_normal,
            split=lambda z: split_log_likelihood(rough, z),
        ),
    )


def split_log_likelihood(target: LogPosterior, z: FloatArray) -> Split:
    """Return log [L(theta) p(theta) / q(theta)] for z (W, d) by the points of all records.

    A point's score is its innovation. Its log scale is chosen so that score and log scale together
    give the point's log density.
    """
    with np.errstate(all="ignore"):
        theta = target.prior.to_parameters(z)
        draws = target.draws(theta)
        parts = [_record_split(target, record, draws) for record in target.records]
        rest = target.log_density_beside_records(theta, z)
    scores, log_scales = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    return Split(scores, log_scales, rest)


def _record_split(
    target: LogPosterior, record: Record, draws: Batch
) -> tuple[FloatArray, FloatArray]:
    residuals = target.residuals(record, draws)
    noise = target.noise_draws(draws, record)
    scores = target.noise.innovations(*residuals, noise)
    log_prob = target.noise.pointwise_log_prob(*residuals, noise)
    log_prob = log_prob + record.log_derivative
    return scores, -log_prob - 0.5 * scores**2


def _noise_factors(target: LogPosterior) -> dict[str, tuple[float, float]]:
    """Root mean squares of the factors on white and correlated noise over each group's points."""
    groups: dict[str, list[Record]] = {}
    for record in target.records:
        groups.setdefault(record.group, []).append(record)
    return {
        group: (
            float(np.sqrt(np.mean(np.concatenate([r.weights for r in records])))),
            float(np.sqrt(np.mean([r.correlated_scale**2 for r in records]))),
        )
        for group, records in groups.items()
    }
