"""How well a candidate predicts blocks of the records that are left out of the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior, log_standard_normal
from deabayes.posteriors.sensitivity import smoothed
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


SMALLEST_GAIN = 4.0
SAFE_GAIN = 8.0
"""Gain in nats from which the larger of two candidates may win despite a large standard error. If
the better of two Gaussian predictions is right, its gain g has the standard deviation sqrt(2 g);
from 8 nats on, g is at least two of these."""


@dataclass(frozen=True)
class BlockLoo:
    """Leave-one-block-out expected log predictive density.

    `terms` (B,) are the contributions of the blocks, which are the same for every candidate of a
    study. `k_hat` (B,) are the Pareto shapes of the blocks' importance weights. `names` say
    where the blocks are.
    """

    terms: FloatArray
    k_hat: FloatArray
    names: tuple[str, ...] = ()

    @property
    def elpd(self) -> float:
        return float(np.sum(self.terms))

    @property
    def se(self) -> float:
        return standard_error(self.terms)


def standard_error(terms: FloatArray) -> float:
    """Standard error of a sum of block terms."""
    return float(np.sqrt(terms.size * np.var(terms, ddof=1))) if terms.size > 1 else float("inf")


def block_edges(coordinate: FloatArray, length: float) -> NDArray[np.intp]:
    """First index of each block; a block is a contiguous stretch at least `length` long.

    With blocks of at least two correlation lengths, the neighbours of a left-out block say
    little about its noise (inference.md, Model order).
    """
    edges, start = [0], coordinate[0]
    for index, value in enumerate(coordinate):
        if value - start >= length and index > edges[-1]:
            edges.append(index)
            start = value
    if len(edges) > 2 and coordinate[-1] - coordinate[edges[-1]] < length / 2:
        edges.pop()
    return np.asarray(edges, dtype=np.intp)


def block_terms(pointwise: FloatArray, edges: NDArray[np.intp]) -> FloatArray:
    """Sum conditional log densities (S, N) over blocks: (S, B)."""
    return np.add.reduceat(pointwise, edges, axis=1)


def leave_one_block_out(terms: FloatArray, names: tuple[str, ...] = ()) -> BlockLoo:
    """Estimate block-LOO by Pareto-smoothed importance sampling (Vehtari, Gelman & Gabry 2017).

    Draws of the full posterior have weights 1 / p(block | theta_s).

    Parameters
    ----------
    terms : (S, B) log p(block | points before it, theta_s).
    """
    from scipy.special import logsumexp

    weighed = [smoothed(-block) for block in terms.T]
    elpd = [
        logsumexp(weights + block) for (weights, _), block in zip(weighed, terms.T, strict=True)
    ]
    return BlockLoo(np.asarray(elpd), np.asarray([k_hat for _, k_hat in weighed]), names)


def favour(gains: FloatArray) -> bool:
    """Whether the gains (B,) of a larger candidate show that it predicts the blocks better.

    Either the sum of the gains exceeds max(4, 2 SE). Or the sum exceeds `SAFE_GAIN`, and the sum
    without the block that gains most exceeds max(4, SE). The second rule is needed because the
    standard error assumes similar blocks. If a fast relaxation shows only in the first block, the
    standard error is more than half of the sum, however large the sum. No block decides alone.
    """
    if _exceeds(gains, SMALLEST_GAIN, 2.0):
        return True
    rest = np.sort(gains)[:-1]
    return _exceeds(gains, SAFE_GAIN, 0.0) and _exceeds(rest, SMALLEST_GAIN, 1.0)


def deciding(gains: FloatArray, evidence: bool) -> int | None:
    """Find the single block that makes left-out blocks and evidence disagree, if there is one.

    Parameters
    ----------
    gains : (B,) gains of the larger candidate over the smaller.
    evidence : whether the evidence favours the larger candidate.

    Returns
    -------
    Index of the block whose gain contradicts the evidence most, if both criteria agree without
    it. Else, if the evidence favours the larger and the sum of the gains exceeds `SAFE_GAIN`,
    index of the block that gains most. None if both criteria agree already, or in other cases.
    """
    if gains.size < 3 or favour(gains) == evidence:
        return None
    against = int(np.argmin(gains) if evidence else np.argmax(gains))
    if favour(np.delete(gains, against)) == evidence:
        return against
    return int(np.argmax(gains)) if evidence and _exceeds(gains, SAFE_GAIN, 0.0) else None


def _exceeds(gains: FloatArray, nats: float, standard_errors: float) -> bool:
    least = standard_errors * standard_error(gains) if standard_errors else 0.0
    return float(np.sum(gains)) > max(nats, least)
