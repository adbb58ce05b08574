"""log p(left out | all else), by sampling from the posterior without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.sampling.cloud import LogDensity, Schedule
from deabayes.sampling.smc import anneal, settle

ON_THE_WAY = Schedule(final_rounds=(0, 0))
"""For a ratio of normalising constants: no draw at the end of the way counts."""
INTO_FAILURE = Schedule(final_rounds=(5, 30), final_forgotten=0.3)


class _Parts:
    """What is left out and the rest at the same draws, each evaluated once."""

    def __init__(self, log_rest: LogDensity, log_left: LogDensity) -> None:
        self._log_rest, self._log_left = log_rest, log_left
        self._at, self._left = np.empty(0), np.empty(0)

    def whole(self, z: FloatArray) -> FloatArray:
        rest = np.asarray(self._log_rest(z))
        self._at, self._left = z, np.asarray(self._log_left(z))
        return rest + self._left

    def removed(self, z: FloatArray) -> FloatArray:
        if z is not self._at:
            self.whole(z)
        return -self._left


def left_out_log_density(
    log_rest: LogDensity,
    log_left: LogDensity,
    z: FloatArray,
    rng: np.random.Generator,
    may_fail: bool = True,
) -> float:
    r"""log p(y_left | y_rest) = log E[L_left(theta) | y_rest].

    Draws of the posterior of all data are annealed to that without y_left,
    p(theta | y) L_left^(-beta), beta 0 -> 1; the ratio of the normalising constants along the
    way is P(L_left > 0 | y_rest) / p(y_left | y_rest). Draws without a response to what is left
    out are not met on it: at its end the draws go on without y_left, and the share of those that
    have a response is the probability.

    Parameters
    ----------
    log_rest : z (W, d) -> (W,), of the posterior without what is left out, unnormalised.
    log_left : z (W, d) -> (W,), log-likelihood of what is left out given the rest; NaN or -inf
        where there is no response.
    z : (S, d) draws of the posterior of all data.
    may_fail : whether log_left may be NaN or -inf where log_rest is finite.
    """
    parts = _Parts(log_rest, log_left)
    found = anneal(z, parts.whole, parts.removed, rng, ON_THE_WAY)
    if not may_fail:
        return -found.log_evidence
    without = settle(found.particles, log_rest, rng, INTO_FAILURE).particles
    share = float(np.mean(np.isfinite(log_left(without))))
    return -found.log_evidence + float(np.log(max(share, 0.5 / len(without))))


def leave_one_experiment_out(
    target: LogPosterior, z: FloatArray, seed: np.random.SeedSequence
) -> dict[str, float]:
    """log p(y_e | all other records) for each calibrated experiment, a gain with its phase.

    Empty for a single experiment. z (S, d) are draws of the posterior.
    """
    rows: dict[str, list[str]] = {}
    for record in target.records:
        rows.setdefault(record.experiment.row, []).append(record.experiment.name)
    if len(rows) < 2:
        return {}
    return {
        name: left_out_log_density(*_without(target, members), z, np.random.default_rng(stream))
        for (name, members), stream in zip(rows.items(), seed.spawn(len(rows)), strict=True)
    }


def _without(target: LogPosterior, members: list[str]) -> tuple[LogDensity, LogDensity]:
    """The posterior without some records, and their log-likelihood."""
    kept = tuple(r for r in target.records if r.experiment.name not in members)

    def log_left(z: FloatArray) -> FloatArray:
        return target.log_likelihood(target.prior.to_parameters(z), members)

    return replace(target, records=kept), log_left


def leave_block_out(
    target: LogPosterior, experiment: str, block: slice, z: FloatArray, rng: np.random.Generator
) -> float:
    """log p(block | all other points) of a record, z (S, d) being draws of the posterior."""

    def log_left(z: FloatArray) -> FloatArray:
        theta = target.prior.to_parameters(z)
        points = target.pointwise_log_likelihood(theta, (experiment,))[experiment]
        return np.asarray(points[:, block].sum(axis=1))

    def log_rest(z: FloatArray) -> FloatArray:
        return target(z) - log_left(z)

    return left_out_log_density(log_rest, log_left, z, rng, may_fail=False)
