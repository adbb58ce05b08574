"""log p(block left out | all else), by carrying draws to the posterior without it.

All blocks of a candidate that are left out, each one alone, are sampled in lockstep: each has
populations of its own, and one call of the forward model serves all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior, log_standard_normal
from deabayes.sampling.problem import Coordinates, Hop, Problem
from deabayes.sampling.tempering import Populations, Schedule, temper

Densities = Callable[[FloatArray, NDArray[np.intp]], tuple[FloatArray, FloatArray]]
"""z (N, d) and the piece (N,) that each row is without -> log density without it, log-likelihood
of it given the rest, (N,) each; NaN or -inf where there is no response."""

AT_THE_TURN = Schedule(final_rounds=(10, 30), crossed=True)
"""Where draws settle without what is left out."""
ON_THE_WAY = Schedule(rounds=(2, 8), final_rounds=(0, 0), crossed=True)
"""For a ratio of normalising constants: no draw at the end of the way counts. With
at most 5 rounds and larger steps the logarithm of the ratio is off by half a nat."""
PAIR = 2
"""Populations of each piece: every other one is moved by proposals fitted to the rest."""


class _Pieces:
    """Densities of rows that come population by population, each evaluated once."""

    def __init__(self, densities: Densities, pieces: int) -> None:
        self._densities, self._pieces = densities, pieces
        self._at: FloatArray | None = None
        self._rest, self._left = np.empty(0), np.empty(0)

    def _evaluate(self, z: FloatArray) -> None:
        if self._at is not z:
            piece = np.repeat(np.arange(self._pieces), len(z) // self._pieces)
            self._rest, self._left = self._densities(z, piece)
            self._at = z

    def rest(self, z: FloatArray) -> FloatArray:
        self._evaluate(z)
        return self._rest

    def left(self, z: FloatArray) -> FloatArray:
        self._evaluate(z)
        return self._left

    def whole(self, z: FloatArray) -> FloatArray:
        self._evaluate(z)
        return self._rest + self._left


def left_out_log_densities(
    densities: Densities,
    pieces: int,
    z: FloatArray,
    seed: np.random.SeedSequence,
    coordinates: Coordinates | None = None,
    hops: Sequence[Hop] = (),
) -> FloatArray:
    r"""log p(y_left | y_rest) = log E[L_left(theta) | y_rest] of every piece, (B,).

    There and back: on the way out, p(theta | y) L_left^(-beta), particles lag behind and the
    ratio of normalising constants comes out too good (by 0.8 in a linear model of 12 parameters),
    so that it only brings the draws to the posterior without y_left. From there they narrow
    again, with the ratio of that way. Draws without a response to what is left out are on
    neither: at the turn the draws go on without y_left, and the share of those that have a
    response is a factor.

    Parameters
    ----------
    pieces : how many are left out, each one alone.
    z : (S, d) draws of the posterior of all data.
    coordinates, hops : of that posterior.
    """
    terms = _Pieces(densities, pieces)
    half = len(z) // PAIR
    start = np.tile(np.stack([z[:half], z[half : 2 * half]]), (pieces, 1, 1))
    ways = iter(seed.spawn(3))

    def along(
        start: FloatArray, base: Callable[..., FloatArray], increment: Callable[..., FloatArray],
        schedule: Schedule,
    ) -> Populations:  # fmt: skip
        return temper(start, base, increment, next(ways), schedule, coordinates, hops)

    out = along(start, terms.whole, lambda z: -terms.left(z), ON_THE_WAY).particles
    without = along(out, terms.rest, lambda z: np.zeros(len(z)), AT_THE_TURN).particles
    responds = np.isfinite(terms.left(without.reshape(-1, z.shape[1]))).reshape(without.shape[:2])
    start = np.where(responds[..., None], without, out)
    back = along(start, terms.rest, terms.left, ON_THE_WAY)
    share = responds.reshape(pieces, -1).mean(axis=1)
    share = np.maximum(share, 0.5 / (PAIR * half))
    both = back.log_evidence.reshape(pieces, PAIR)
    return np.asarray(np.log(share) + np.logaddexp.reduce(both, axis=1) - np.log(PAIR))


def leave_blocks_out(
    target: LogPosterior,
    problem: Problem,
    blocks: Sequence[tuple[str, slice]],
    z: FloatArray,
    seed: np.random.SeedSequence,
) -> FloatArray:
    """log p(block | points before it, parameters as all other terms have them) of blocks, (B,).

    The density is a product of terms log p(y_k | y_1..k-1, theta). Those of the block are left
    out of the posterior; its points remain what later terms are conditional on.

    Parameters
    ----------
    blocks : name of the record and points.
    z : (S, d) draws of the posterior.
    """

    def densities(z: FloatArray, piece: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        by_record, rest = _terms(target, z)
        rest = rest + sum(points.sum(axis=1) for points in by_record.values())
        left = np.empty(len(z))
        for index, (name, block) in enumerate(blocks):
            rows = piece == index
            left[rows] = by_record[name][rows, block].sum(axis=1)
        return rest - left, left

    return left_out_log_densities(
        densities, len(blocks), z, seed, problem.coordinates, problem.hops
    )


def _terms(target: LogPosterior, z: FloatArray) -> tuple[dict[str, FloatArray], FloatArray]:
    """Log densities of all points, (N, points), by record, and what else the posterior holds."""
    with np.errstate(all="ignore"):
        theta = target.prior.to_parameters(z)
        by_record = target.pointwise_log_likelihood(theta)
        rest = target.log_density_beside_records(theta, z) + log_standard_normal(z)
    return by_record, rest
