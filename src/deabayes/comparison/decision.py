"""Decide which model order the records support, and whether they can decide at all.

Every rule of the comparison stands here. `evidence_favours` and `blocks_favour` are its two
criteria, `judge` compares two candidates by both, and `decide` chooses among all candidates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.comparison.blocks import BlockLoo, standard_error
from deabayes.experiment import FloatArray

SMALLEST_EVIDENCE_GAIN = 2.0
"""Gain in log evidence [nats], odds of 7 to 1, below which evidence does not favour the larger."""
CLEAR_EVIDENCE = 3.0
"""Gain in log evidence [nats], odds of 20 to 1, that decides unless left-out blocks object."""
LARGEST_EVIDENCE_DIFFERENCE = 0.5
"""Nats by which bridge and nested sampling may differ, on top of their errors (inference.md)."""
SMALLEST_GAIN = 4.0
SAFE_GAIN = 8.0
"""Gain in nats from which the larger of two candidates may win despite a large standard error. If
the better of two Gaussian predictions is right, its gain g has the standard deviation sqrt(2 g);
from 8 nats on, g is at least two of these."""


@dataclass(frozen=True)
class Score:
    """Scores of one candidate; `loo` is None if the candidate is not ranked."""

    candidate: str
    order: int
    n_parameters: int
    converged: bool
    log_evidence: float
    log_evidence_mcse: float
    bic: float
    loo: BlockLoo | None
    leave_one_experiment_out: float = float("nan")
    log_evidence_nested: float = float("nan")
    log_evidence_nested_error: float = float("nan")

    @property
    def evidence_conflict(self) -> bool:
        """Whether bridge and nested sampling disagree on the evidence.

        They may differ by 0.5 nat plus the root of the sum of their squared standard errors. An
        unknown error counts as zero.
        """
        allowed = LARGEST_EVIDENCE_DIFFERENCE + self.evidence_error
        return abs(self.log_evidence - self.log_evidence_nested) > allowed

    @property
    def evidence_error(self) -> float:
        """Standard error of the difference of both evidences; an unknown error counts as zero."""
        errors = np.nan_to_num([self.log_evidence_mcse, self.log_evidence_nested_error])
        return float(np.hypot(*errors))


@dataclass(frozen=True)
class Decision:
    """The chosen candidate, and those that the data do not separate from the chosen one."""

    chosen: str | None
    unresolved: tuple[str, ...] = ()


def decide(scores: Sequence[Score]) -> Decision:
    """Go up from the fewest parameters; choose the next candidate only if `judge` says `larger`.

    A single ranked candidate of several is not chosen, because there is nothing to compare.
    """
    ranked = sorted((s for s in scores if s.loo is not None), key=lambda s: s.n_parameters)
    if not ranked or (len(ranked) == 1 and len(scores) > 1):
        return Decision(None)
    chosen = ranked[0]
    for candidate in ranked[1:]:
        if judge(candidate, chosen) == "larger":
            chosen = candidate
    others = [s for s in ranked if s is not chosen]
    return Decision(
        chosen.candidate, tuple(s.candidate for s in others if not is_favoured(chosen, s))
    )


def is_favoured(chosen: Score, other: Score) -> bool:
    """Whether a direct comparison favours the chosen candidate over another one.

    `decide` may not have compared this pair: a candidate that it passed over because of a
    conflict with a smaller one may not lose against the one chosen later.
    """
    if chosen.n_parameters >= other.n_parameters:
        return judge(chosen, other) == "larger"
    return judge(other, chosen) == "smaller"


def judge(larger: Score, smaller: Score) -> str:
    """Compare two candidates: `larger`, `smaller` or `conflict`.

    The larger wins if the evidence favours it, and either the evidence is clear and left-out
    blocks do not object, or left-out blocks favour it too. The smaller wins if neither criterion
    favours the larger. Otherwise, or if an evidence, error or block is not known, the data do not
    resolve the two: `conflict`.

    Evidence may decide alone because a process can show in a single block: a fast relaxation
    shows only at the beginning of a creep record. Blocks at the ends of records do not count.
    """
    by_evidence, gained = evidence_favours(larger, smaller), gains(larger, smaller)
    if by_evidence is None or np.isnan(gained).any():
        return "conflict"
    clear = larger.log_evidence - smaller.log_evidence > CLEAR_EVIDENCE
    if by_evidence and (blocks_favour(gained) or (clear and not blocks_object(gained))):
        return "larger"
    return "conflict" if by_evidence or blocks_favour(gained) else "smaller"


def gains(larger: Score, smaller: Score) -> FloatArray:
    """Gain of `larger` over `smaller` in log predictive density per deciding block, (B,) nats."""
    assert larger.loo is not None and smaller.loo is not None
    return (larger.loo.terms - smaller.loo.terms)[larger.loo.interior]


def evidence_favours(larger: Score, smaller: Score) -> bool | None:
    """Whether the evidence favours the larger candidate.

    None if the evidence or its error is not known. Also None if bridge and nested sampling
    disagree on a candidate's evidence and lead to different answers.
    """
    by_bridge = _exceeds_error(
        larger.log_evidence - smaller.log_evidence,
        np.hypot(larger.log_evidence_mcse, smaller.log_evidence_mcse),
    )
    if not larger.evidence_conflict and not smaller.evidence_conflict:
        return by_bridge
    by_nested = _exceeds_error(
        larger.log_evidence_nested - smaller.log_evidence_nested,
        np.hypot(larger.log_evidence_nested_error, smaller.log_evidence_nested_error),
    )
    return by_bridge if by_bridge == by_nested else None


def _exceeds_error(gain: float, error: float) -> bool | None:
    """Whether a gain in log evidence favours a candidate; None if gain or error is not known."""
    if not np.isfinite([gain, error]).all():
        return None
    return bool(gain > max(SMALLEST_EVIDENCE_GAIN, 2.0 * error))


def blocks_favour(gains: FloatArray) -> bool:
    """Whether the gains (B,) of a larger candidate show that it predicts the blocks better.

    Either the sum of the gains exceeds max(4, 2 SE). Or the sum exceeds `SAFE_GAIN`, and the sum
    without the block that gains most exceeds max(4, SE). The second rule is needed because the
    standard error assumes similar blocks. If a fast relaxation shows only in the first block, the
    standard error is more than half of the sum, however large the sum. No block decides alone.
    """
    if _sum_exceeds(gains, SMALLEST_GAIN, 2.0):
        return True
    rest = np.sort(gains)[:-1]
    return _sum_exceeds(gains, SAFE_GAIN, 0.0) and _sum_exceeds(rest, SMALLEST_GAIN, 1.0)


def blocks_object(gains: FloatArray) -> bool:
    """Whether a larger candidate predicts the blocks worse by more than a standard error."""
    return _sum_exceeds(-gains, 0.0, 1.0)


def decisive_block(gains: FloatArray, by_evidence: bool) -> int | None:
    """Find the single block that makes left-out blocks and evidence disagree, if there is one.

    Parameters
    ----------
    gains : (B,) gains of the larger candidate over the smaller.
    by_evidence : whether the evidence favours the larger candidate.

    Returns
    -------
    Index among the deciding blocks of the one whose gain contradicts the evidence most, if both
    criteria agree without it. Else, if the evidence favours the larger and the sum of the gains
    exceeds `SAFE_GAIN`, index of the block that gains most. None if both criteria agree already,
    or in other cases.
    """
    if gains.size < 3 or blocks_favour(gains) == by_evidence:
        return None
    against = int(np.argmin(gains) if by_evidence else np.argmax(gains))
    if blocks_favour(np.delete(gains, against)) == by_evidence:
        return against
    return int(np.argmax(gains)) if by_evidence and _sum_exceeds(gains, SAFE_GAIN, 0.0) else None


def _sum_exceeds(gains: FloatArray, nats: float, standard_errors: float) -> bool:
    least = standard_errors * standard_error(gains) if standard_errors else 0.0
    return float(np.sum(gains)) > max(nats, least)
