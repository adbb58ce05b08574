"""Decide which model order the records support, and whether they can decide at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.comparison.left_out import BlockLoo, deciding, favour, standard_error
from deabayes.experiment import FloatArray

SMALLEST_EVIDENCE_GAIN = 1.0
LARGEST_EVIDENCE_DIFFERENCE = 0.5
"""Nats by which bridge and nested sampling may differ, on top of their errors (inference.md)."""
NOT_RANKED = "not ranked"
SHOWN = "^chosen: |^not resolved by these data against "
"""Pattern in the verdict of the candidate that `decide` chose."""


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
    leave_one_experiment_out: float
    loo: BlockLoo | None
    log_evidence_nested: float = float("nan")
    log_evidence_nested_error: float = float("nan")


def gains(larger: Score, smaller: Score) -> FloatArray:
    """Gain in log predictive density of `larger` over `smaller` per left-out block, (B,) nats."""
    assert larger.loo is not None and smaller.loo is not None
    return larger.loo.terms - smaller.loo.terms


def elpd_difference(larger: Score, smaller: Score) -> tuple[float, float]:
    """Difference elpd(larger) - elpd(smaller) and its standard error, over paired blocks."""
    difference = gains(larger, smaller)
    return float(np.sum(difference)), standard_error(difference)


def evidence_favours(larger: Score, smaller: Score) -> bool | None:
    """Whether the evidence favours the larger candidate.

    None if the evidence or its error is not known. Also None if bridge and nested sampling
    disagree on a candidate's evidence (`evidence_conflict`) and lead to different answers.
    """
    by_bridge = _favours(
        larger.log_evidence - smaller.log_evidence,
        np.hypot(larger.log_evidence_mcse, smaller.log_evidence_mcse),
    )
    if not evidence_conflict(larger) and not evidence_conflict(smaller):
        return by_bridge
    by_nested = _favours(
        larger.log_evidence_nested - smaller.log_evidence_nested,
        np.hypot(larger.log_evidence_nested_error, smaller.log_evidence_nested_error),
    )
    return by_bridge if by_bridge == by_nested else None


def _favours(gain: float, error: float) -> bool | None:
    """Whether a gain in log evidence favours a candidate; None if gain or error is not known."""
    if not np.isfinite([gain, error]).all():
        return None
    return bool(gain > max(SMALLEST_EVIDENCE_GAIN, 2.0 * error))


def judge(larger: Score, smaller: Score) -> str:
    """Compare two candidates: `larger`, `smaller` or `conflict`.

    The larger wins only if it predicts left-out blocks better (`left_out.favour`) and the evidence
    favours it too. The smaller wins if neither criterion favours the larger. Otherwise, or if an
    evidence, error or block is not known, the data do not resolve the two: `conflict`.
    """
    by_evidence, gained = evidence_favours(larger, smaller), gains(larger, smaller)
    if by_evidence is None or np.isnan(gained).any() or favour(gained) != by_evidence:
        return "conflict"
    return "larger" if by_evidence else "smaller"


@dataclass(frozen=True)
class Decision:
    """The chosen candidate, and those that the data do not separate from the chosen one."""

    chosen: str | None
    unresolved: tuple[str, ...]
    verdicts: Mapping[str, str]


def decide(scores: Sequence[Score]) -> Decision:
    """Go up from the fewest parameters; choose the next candidate only if `judge` says `larger`."""
    ranked = sorted((s for s in scores if s.loo is not None), key=lambda s: s.n_parameters)
    verdicts = {
        s.candidate: f"{NOT_RANKED}: not converged" if not s.converged else NOT_RANKED
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
        if s is not chosen:
            verdicts[s.candidate] = _verdict(s, chosen, unresolved)
    verdicts[chosen.candidate] = (
        _not_resolved(chosen, [s for s in ranked if s.candidate in unresolved])
        if unresolved
        else _chosen(chosen, scores)
    )
    return Decision(chosen.candidate, unresolved, verdicts)


def _favoured(chosen: Score, other: Score) -> bool:
    """Whether a direct comparison favours the chosen candidate over another one.

    `decide` may not have compared this pair: a candidate that it passed over because of a
    conflict with a smaller one may not lose against the one chosen later.
    """
    if chosen.n_parameters >= other.n_parameters:
        return judge(chosen, other) == "larger"
    return judge(other, chosen) == "smaller"


def _chosen(chosen: Score, scores: Sequence[Score]) -> str:
    if len(scores) == 1:
        return "chosen: the only candidate that was compared"
    words = "chosen: the smallest order the data cannot do without"
    lost = [s.candidate for s in scores if s.loo is None]
    if not lost:
        return words
    return f"{words} among those that converged; {', '.join(lost)} did not"


def _not_resolved(chosen: Score, others: Sequence[Score]) -> str:
    """Verdict of the chosen candidate if the data do not separate others from it."""
    words = f"not resolved by these data against {', '.join(s.candidate for s in others)}"
    smaller = [s.candidate for s in others if s.n_parameters < chosen.n_parameters]
    if not smaller:
        return f"{words}; the smallest order"
    return f"{words}; shown, though {', '.join(smaller)} has fewer parameters and may do"


def _verdict(score: Score, chosen: Score, unresolved: Sequence[str]) -> str:
    gain, se = elpd_difference(score, chosen)
    evidence = score.log_evidence - chosen.log_evidence
    figures = (
        f"elpd {gain:+.1f} (SE {se:.1f}), log evidence {evidence:+.1f} against {chosen.candidate}"
    )
    if score.candidate in unresolved:
        return f"not resolved by these data: {figures}{_one_block(score, chosen)}"
    return f"not chosen: {figures}"


def _one_block(score: Score, chosen: Score) -> str:
    """Name the block that alone makes the two criteria disagree; empty if there is none."""
    larger, smaller = sorted((chosen, score), key=lambda s: s.n_parameters)[::-1]
    by_evidence = evidence_favours(larger, smaller)
    if by_evidence is None:
        return ""
    gained = gains(score, chosen)
    block = deciding(gains(larger, smaller), by_evidence)
    if block is None or score.loo is None or not score.loo.names:
        return ""
    rest = np.delete(gained, block)
    return (
        f"; one block decides, {score.loo.names[block]} (elpd {gained[block]:+.1f}): the others "
        f"have {np.sum(rest):+.1f} (SE {standard_error(rest):.1f})"
    )


def evidence_conflict(score: Score) -> str:
    """Report that bridge and nested sampling disagree on the evidence; empty if they agree.

    They may differ by 0.5 nat plus the root of the sum of their squared standard errors. An
    unknown error counts as zero.
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
