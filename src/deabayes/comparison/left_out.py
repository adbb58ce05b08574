"""Log predictive density of data that are left out of a posterior, by tempering."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior, log_standard_normal
from deabayes.sampling.problem import Coordinates, Hop, Problem
from deabayes.sampling.tempering import Populations, Schedule, temper

Densities = Callable[[FloatArray, NDArray[np.intp]], tuple[FloatArray, FloatArray]]
"""Function of z (N, d) and the index (N,) of the piece that each row leaves out. Returns the log
density without that piece and the piece's log-likelihood given the rest, both (N,). They are NaN
or -inf where there is no response."""

AT_THE_TURN = Schedule(final_rounds=(10, 30), crossed=True)
"""Schedule for draws that settle in the posterior without the left-out piece."""
ON_THE_WAY = Schedule(rounds=(2, 8), final_rounds=(0, 0), crossed=True)
"""Schedule for a ratio of normalising constants, which does not use the final draws. With at most
5 rounds and larger steps the logarithm of the ratio is wrong by half a nat."""
PAIR = 2
"""Populations per piece. Proposals for one half of all populations are fitted to the other half."""


class _Pieces:
    """Densities of rows grouped by piece; the densities of one z are evaluated only once."""

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

    Tempering goes out and back. On the way out, p(theta | y) L_left^(-beta), the particles lag
    behind and the ratio of normalising constants is too large (by 0.8 in a linear model of 12
    parameters). The way out therefore only carries the draws to the posterior without y_left.
    On the way back the draws narrow again; this way gives the ratio.

    Neither way covers draws without a response to the left-out data. Between the two ways, draws
    therefore move in the posterior without y_left, and the share of them that have a response
    multiplies the result.

    Parameters
    ----------
    pieces : number of pieces; each is left out alone.
    z : (S, d) draws of the posterior of all data.
    coordinates, hops : coordinates and hops for the posterior of all data.
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
    """log p(block | points before it) of each block, (B,), over the posterior without its terms.

    The log-likelihood is a sum of terms log p(y_k | y_1..k-1, theta). The terms of the block are
    left out of the posterior, but later terms are still conditional on the block's points.

    Parameters
    ----------
    blocks : name of the record and slice of its points.
    z : (S, d) draws of the posterior of all data.
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
    """Log densities (N, points) by record, and the other terms of the log posterior (N,)."""
    with np.errstate(all="ignore"):
        theta = target.prior.to_parameters(z)
        by_record = target.pointwise_log_likelihood(theta)
        rest = target.log_density_beside_records(theta, z) + log_standard_normal(z)
    return by_record, rest
