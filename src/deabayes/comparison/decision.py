"""Which model order the records support, and when they cannot say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.pareto import smoothed

SMALLEST_ELPD_GAIN = 4.0
SAFE_ELPD_GAIN = 8.0
"""A gain of g nats between two Gaussian predictions, the better of which is right, has a standard
deviation of sqrt(2 g): from here on g is two of these and more."""
SMALLEST_EVIDENCE_GAIN = 1.0
LARGEST_EVIDENCE_DIFFERENCE = 0.5
"""Nats, beyond the errors, that bridge and nested sampling may differ by (inference.md)."""


@dataclass(frozen=True)
class BlockLoo:
    """Leave-one-block-out expected log predictive density.

    `terms` (B,) are the blocks' contributions, the same blocks for every
    candidate of a study; `k_hat` (B,) the Pareto shape of their importance weights.
    """

    terms: FloatArray
    k_hat: FloatArray

    @property
    def elpd(self) -> float:
        return float(np.sum(self.terms))

    @property
    def se(self) -> float:
        return standard_error(self.terms)


@dataclass(frozen=True)
class Score:
    """What one candidate brings to the comparison; `loo` is None when it is not ranked."""

    candidate: str
    order: int
    n_parameters: int
    converged: bool
    log_evidence: float
    log_evidence_mcse: float
    bic: float
    leave_one_experiment_out: float
    loo: BlockLoo | None
    log_evidence_nested: float = float("nan")
    log_evidence_nested_error: float = float("nan")


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


def leave_one_block_out(terms: FloatArray) -> BlockLoo:
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
    return BlockLoo(np.asarray(elpd), np.asarray([k_hat for _, k_hat in weighed]))


def elpd_difference(larger: Score, smaller: Score) -> tuple[float, float]:
    """elpd(larger) - elpd(smaller) with its standard error, over paired blocks."""
    assert larger.loo is not None and smaller.loo is not None
    difference = larger.loo.terms - smaller.loo.terms
    return float(np.sum(difference)), standard_error(difference)


def left_out_blocks_favour(larger: Score, smaller: Score) -> bool:
    """Whether the larger candidate tells left-out blocks better.

    Its elpd gain exceeds max(4, 2 SE); or it exceeds `SAFE_ELPD_GAIN`, and what is left of it
    without the block that gains most max(4, SE). The standard error is for blocks that are
    alike: where a fast unit shows in the first of them only, it is more than half of the sum,
    however large that is. No block decides alone.
    """
    assert larger.loo is not None and smaller.loo is not None
    gains = np.sort(larger.loo.terms - smaller.loo.terms)
    if _exceeds(gains, SMALLEST_ELPD_GAIN, 2.0):
        return True
    return _exceeds(gains, SAFE_ELPD_GAIN, 0.0) and _exceeds(gains[:-1], SMALLEST_ELPD_GAIN, 1.0)


def _exceeds(gains: FloatArray, nats: float, standard_errors: float) -> bool:
    least = standard_errors * standard_error(gains) if standard_errors else 0.0
    return float(np.sum(gains)) > max(nats, least)


def judge(larger: Score, smaller: Score) -> str:
    """Compare two candidates: `larger`, `smaller` or `conflict`.

    The larger wins only if it tells left-out blocks better (`left_out_blocks_favour`)
    and the evidence agrees; the smaller wins if neither criterion speaks for the
    larger. All else, and an evidence or error that is not known, is a conflict: these data do
    not resolve it.
    """
    elpd_for_larger = left_out_blocks_favour(larger, smaller)
    evidence_gain = larger.log_evidence - smaller.log_evidence
    error = float(np.hypot(larger.log_evidence_mcse, smaller.log_evidence_mcse))
    if not np.isfinite([evidence_gain, error]).all():
        return "conflict"
    evidence_for_larger = evidence_gain > max(SMALLEST_EVIDENCE_GAIN, 2.0 * error)
    if elpd_for_larger and evidence_for_larger:
        return "larger"
    if not elpd_for_larger and not evidence_for_larger:
        return "smaller"
    return "conflict"


@dataclass(frozen=True)
class Decision:
    """`chosen` among the ranked candidates, and those that the data do not separate from it."""

    chosen: str | None
    unresolved: tuple[str, ...]
    verdicts: Mapping[str, str]


def decide(scores: Sequence[Score]) -> Decision:
    """Walk from the fewest parameters upwards, moving on only where `judge` says `larger`."""
    ranked = sorted((s for s in scores if s.loo is not None), key=lambda s: s.n_parameters)
    verdicts = {
        s.candidate: "not ranked: not converged" if not s.converged else "not ranked"
        for s in scores
        if s.loo is None
    }
    if not ranked:
        return Decision(None, (), verdicts)
    if len(ranked) == 1 and len(scores) > 1:
        only = ranked[0].candidate
        verdicts[only] = "nothing to compare: the only candidate that converged"
        return Decision(None, (), verdicts)
    chosen = ranked[0]
    for candidate in ranked[1:]:
        if judge(candidate, chosen) == "larger":
            chosen = candidate
    unresolved = tuple(s.candidate for s in ranked if s is not chosen and not _favoured(chosen, s))
    for s in ranked:
        verdicts[s.candidate] = _verdict(s, chosen, unresolved)
    if not unresolved:
        verdicts[chosen.candidate] = _chosen(chosen, scores)
    return Decision(chosen.candidate, unresolved, verdicts)


def _favoured(chosen: Score, other: Score) -> bool:
    """Whether the pair, judged by itself, speaks for the chosen one.

    The walk need not have met this pair: a candidate passed over in a conflict with a
    smaller one may hold its own against what was chosen later.
    """
    if chosen.n_parameters >= other.n_parameters:
        return judge(chosen, other) == "larger"
    return judge(other, chosen) == "smaller"


def _chosen(chosen: Score, scores: Sequence[Score]) -> str:
    if len(scores) == 1:
        return "chosen: the only candidate that was compared"
    words = "chosen: the smallest order the data cannot do without"
    smaller = [
        s.candidate for s in scores if s.loo is None and s.n_parameters < chosen.n_parameters
    ]
    if not smaller:
        return words
    return f"{words} among those that converged; {', '.join(smaller)} did not"


def _verdict(score: Score, chosen: Score, unresolved: Sequence[str]) -> str:
    if score is chosen:
        return (
            f"not resolved by these data against {', '.join(unresolved)}; smallest adequate order"
        )
    gain, se = elpd_difference(score, chosen)
    evidence = score.log_evidence - chosen.log_evidence
    figures = (
        f"elpd {gain:+.1f} (SE {se:.1f}), log evidence {evidence:+.1f} against {chosen.candidate}"
    )
    if score.candidate in unresolved:
        return f"not resolved by these data: {figures}"
    return f"not chosen: {figures}"


def evidence_conflict(score: Score) -> str:
    """Say that bridge and nested sampling do not agree on the evidence; empty if they do.

    They may differ by 0.5 nat and their two standard errors taken together; an error that is not
    known counts as none.
    """
    difference = score.log_evidence - score.log_evidence_nested
    error = float(
        np.hypot(*np.nan_to_num([score.log_evidence_mcse, score.log_evidence_nested_error]))
    )
    if not abs(difference) > LARGEST_EVIDENCE_DIFFERENCE + error:
        return ""
    return (
        f"bridge and nested sampling differ by {difference:+.1f} (standard error {error:.1f}) in "
        "log evidence: rely on neither"
    )
