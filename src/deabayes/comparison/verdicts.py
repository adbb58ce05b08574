"""Verdicts of comparison.csv in words: what was decided, and by how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deabayes.comparison.blocks import standard_error
from deabayes.comparison.decision import (
    Decision,
    Score,
    decisive_block,
    evidence_favours,
    gains,
)

NOT_RANKED = "not ranked"
CHOSEN = "^chosen: |^not resolved by these data against "
"""Pattern in the verdict of the candidate that `decide` chose."""


def verdicts(scores: Sequence[Score], decision: Decision) -> dict[str, str]:
    """Return the verdict on every candidate, by its name."""
    chosen = next((s for s in scores if s.candidate == decision.chosen), None)
    return {s.candidate: _verdict(s, chosen, scores, decision) + _conflict(s) for s in scores}


def elpd_difference(one: Score, other: Score) -> tuple[float, float]:
    """Difference elpd(one) - elpd(other) and its standard error, over paired blocks."""
    difference = gains(one, other)
    return float(np.sum(difference)), standard_error(difference)


def _verdict(
    score: Score, chosen: Score | None, scores: Sequence[Score], decision: Decision
) -> str:
    if score.loo is None:
        return NOT_RANKED if score.converged else f"{NOT_RANKED}: not converged"
    if chosen is None:
        return "nothing to compare: the only candidate that converged"
    if score is not chosen:
        return _of_another(score, chosen, score.candidate in decision.unresolved)
    if decision.unresolved:
        return _not_resolved(chosen, [s for s in scores if s.candidate in decision.unresolved])
    return _of_chosen(scores)


def _of_chosen(scores: Sequence[Score]) -> str:
    if len(scores) == 1:
        return "chosen: the only candidate that was compared"
    words = "chosen: the smallest order the data cannot do without"
    lost = [s.candidate for s in scores if s.loo is None]
    return f"{words} among those that converged; {', '.join(lost)} did not" if lost else words


def _not_resolved(chosen: Score, others: Sequence[Score]) -> str:
    """Verdict on the chosen candidate if the data do not separate others from it."""
    others = sorted(others, key=lambda s: s.n_parameters)
    words = f"not resolved by these data against {', '.join(s.candidate for s in others)}"
    smaller = [s.candidate for s in others if s.n_parameters < chosen.n_parameters]
    if not smaller:
        return f"{words}; the smallest order"
    return f"{words}; the fewer parameters of {', '.join(smaller)} may be enough"


def _of_another(score: Score, chosen: Score, unresolved: bool) -> str:
    gain, se = elpd_difference(score, chosen)
    evidence = score.log_evidence - chosen.log_evidence
    figures = (
        f"elpd {gain:+.1f} (SE {se:.1f}), log evidence {evidence:+.1f} against {chosen.candidate}"
    )
    if unresolved:
        return f"not resolved by these data: {figures}{_decisive(score, chosen)}"
    return f"not chosen: {figures}"


def _decisive(score: Score, chosen: Score) -> str:
    """Name the block that alone makes the two criteria disagree; empty if there is none."""
    smaller, larger = sorted((chosen, score), key=lambda s: s.n_parameters)
    by_evidence = evidence_favours(larger, smaller)
    if by_evidence is None or score.loo is None or not score.loo.names:
        return ""
    block = decisive_block(gains(larger, smaller), by_evidence)
    if block is None:
        return ""
    gained = gains(score, chosen)
    rest = np.delete(gained, block)
    return (
        f"; one block decides, {score.loo.names[block]} (elpd {gained[block]:+.1f}): the others "
        f"have {np.sum(rest):+.1f} (SE {standard_error(rest):.1f})"
    )


def _conflict(score: Score) -> str:
    """Say that bridge and nested sampling disagree on the evidence; empty if they agree."""
    if not score.evidence_conflict:
        return ""
    difference = score.log_evidence - score.log_evidence_nested
    return (
        f"; bridge and nested sampling differ by {difference:+.1f} (standard error "
        f"{score.evidence_error:.1f}) in log evidence: rely on neither"
    )
