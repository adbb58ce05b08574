"""Leave-one-block-out: how well a candidate tells stretches of the records it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.pareto import smoothed

SMALLEST_GAIN = 4.0
SAFE_GAIN = 8.0
"""A gain of g nats between two Gaussian predictions, the better of which is right, has a standard
deviation of sqrt(2 g): from here on g is two of these and more."""


@dataclass(frozen=True)
class BlockLoo:
    """Leave-one-block-out expected log predictive density.

    `terms` (B,) are the blocks' contributions, the same blocks for every
    candidate of a study; `k_hat` (B,) the Pareto shape of their importance weights;
    `names` say where the blocks are.
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
    """First index of each block: contiguous stretches at least `length` long.

    Blocks of two correlation lengths and more keep a left-out block from being
    told by its neighbours (inference.md, Model order).
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
    """Pareto-smoothed importance sampling over blocks (Vehtari, Gelman & Gabry 2017).

    Draws of the full posterior have weights 1 / p(block | theta_s).

    Parameters
    ----------
    terms : (S, B) log p(block | what precedes it, theta_s).
    """
    from scipy.special import logsumexp

    weighed = [smoothed(-block) for block in terms.T]
    elpd = [
        logsumexp(weights + block) for (weights, _), block in zip(weighed, terms.T, strict=True)
    ]
    return BlockLoo(np.asarray(elpd), np.asarray([k_hat for _, k_hat in weighed]), names)


def favour(gains: FloatArray) -> bool:
    """Whether a larger candidate that gains this on each block, (B,), tells them better.

    Its elpd gain exceeds max(4, 2 SE); or it exceeds `SAFE_GAIN`, and what is left of it
    without the block that gains most max(4, SE). The standard error is for blocks that are
    alike: where a fast unit shows in the first of them only, it is more than half of the sum,
    however large that is. No block decides alone.
    """
    if _exceeds(gains, SMALLEST_GAIN, 2.0):
        return True
    rest = np.sort(gains)[:-1]
    return _exceeds(gains, SAFE_GAIN, 0.0) and _exceeds(rest, SMALLEST_GAIN, 1.0)


def deciding(gains: FloatArray, evidence: bool) -> int | None:
    """The block that keeps left-out blocks and evidence apart, if it is a single one.

    Parameters
    ----------
    gains : (B,) of the larger candidate over the smaller.
    evidence : whether the evidence is for the larger.

    Returns
    -------
    the block without which both would say the same, that which speaks loudest against the
    evidence; or one that has nearly all of a gain that would be enough (`SAFE_GAIN`). None where
    they say the same, or where more than one block is against it.
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
