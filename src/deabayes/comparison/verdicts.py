"""Verdicts of comparison.csv in words: what was decided, how surely, and by how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deabayes.comparison.blocks import standard_error
from deabayes.comparison.decision import (
    SMALLEST_GAIN,
    Decision,
    Score,
    decisive_block,
    evidence_favours,
    gains,
)
from deabayes.quantities import significant

NOT_RANKED = "not ranked"
CHOSEN = "^chosen: |^not resolved by these data against "
"""Pattern in the verdict of the candidate that `decide` chose."""
STRENGTHS = ((5.0, "very strong"), (3.0, "strong"), (1.0, "positive"), (0.0, "weak"))
"""Words for log Bayes factors [nats] from the given size on (Kass & Raftery 1995,
10.1080/01621459.1995.10476572)."""
LARGEST_ODDS = 1000.0


def verdicts(scores: Sequence[Score], decision: Decision) -> dict[str, str]:
    """Return the verdict on every candidate, by its name."""
    chosen = next((s for s in scores if s.candidate == decision.chosen), None)
    return {s.candidate: _verdict(s, chosen, scores, decision) + _conflict(s) for s in scores}


def elpd_difference(one: Score, other: Score) -> tuple[float, float]:
    """Difference elpd(one) - elpd(other) and its standard error, over paired deciding blocks."""
    difference = gains(one, other)
    return float(np.sum(difference)), standard_error(difference)


def ends_difference(one: Score, other: Score) -> float:
    """Difference in log predictive density at the ends of the records, nats."""
    return float(sum(difference for difference, _ in _at_ends(one, other)))


def _at_ends(one: Score, other: Score) -> list[tuple[float, str]]:
    """Differences at the blocks that do not decide, and where these blocks are."""
    assert one.loo is not None and other.loo is not None
    difference, names = one.loo.terms - other.loo.terms, one.loo.names
    return [
        (float(difference[k]), names[k] if names else "") for k in np.flatnonzero(~one.loo.interior)
    ]


def odds(nats: float) -> str:
    """Say what a difference in log evidence means: its strength, and the odds."""
    strength = next((word for least, word in STRENGTHS if abs(nats) >= least), "no")
    ratio = np.exp(min(abs(nats), 100.0))
    shown = f"{LARGEST_ODDS:g}" if ratio > LARGEST_ODDS else significant(float(ratio), 2)
    return f"{strength}, odds {'over ' if ratio > LARGEST_ODDS else ''}{shown} to 1"


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
    return _of_chosen(chosen, scores)


def _of_chosen(chosen: Score, scores: Sequence[Score]) -> str:
    if len(scores) == 1:
        return "chosen: the only candidate that was compared"
    words = "chosen: the smallest order the data cannot do without"
    lost = [s.candidate for s in scores if s.loo is None]
    if lost:
        words += f" among those that converged; {', '.join(lost)} did not"
    ranked = [s for s in scores if s.loo is not None]
    return words + _how_sure(chosen, ranked) + _better_on_records(chosen, ranked)


def _how_sure(chosen: Score, ranked: Sequence[Score]) -> str:
    """Say how surely the evidence separates the chosen candidate from others, small and large."""
    most = chosen.n_parameters
    small = [s for s in ranked if s is not chosen and s.n_parameters <= most]
    large = [s for s in ranked if s.n_parameters > most]
    words = ""
    if small:
        best = max(small, key=lambda s: s.log_evidence)
        words += f"; evidence for it over {best.candidate}: "
        words += odds(chosen.log_evidence - best.log_evidence)
    if large:
        best = max(large, key=lambda s: s.log_evidence)
        gain = best.log_evidence - chosen.log_evidence
        side = "for" if gain > 0.0 else "against"
        words += f"; evidence {side} the larger {best.candidate}: {odds(gain)}"
    return words


def _better_on_records(chosen: Score, ranked: Sequence[Score]) -> str:
    """Name the candidate that predicts whole records, left out of the fit, better."""
    known = [s for s in ranked if np.isfinite(s.leave_one_experiment_out)]
    if chosen not in known:
        return ""
    best = max(known, key=lambda s: s.leave_one_experiment_out)
    gain = best.leave_one_experiment_out - chosen.leave_one_experiment_out
    if not gain > SMALLEST_GAIN:
        return ""
    return (
        f"; but {best.candidate} predicts records left out of the fit better, by {gain:.0f} nats: "
        "prefer it for experiments unlike the fitted ones"
    )


def _not_resolved(chosen: Score, others: Sequence[Score]) -> str:
    """Verdict on the chosen candidate if the data do not separate others from it."""
    others = sorted(others, key=lambda s: s.n_parameters)
    words = f"not resolved by these data against {', '.join(s.candidate for s in others)}"
    smaller = [s.candidate for s in others if s.n_parameters < chosen.n_parameters]
    if not smaller:
        return f"{words}; use {chosen.candidate} meanwhile, the smallest order"
    return (
        f"{words}; use {chosen.candidate} meanwhile, though the fewer parameters of "
        f"{', '.join(smaller)} may be enough"
    )


def _of_another(score: Score, chosen: Score, unresolved: bool) -> str:
    gain, se = elpd_difference(score, chosen)
    evidence = score.log_evidence - chosen.log_evidence
    figures = (
        f"elpd {gain:+.1f} (SE {se:.1f}), log evidence {evidence:+.1f} against {chosen.candidate}"
    )
    figures += _extrapolates_better(score, chosen)
    if unresolved:
        return f"not resolved by these data: {figures}{_decisive(score, chosen)}"
    return f"not chosen: {figures}"


def _extrapolates_better(score: Score, chosen: Score) -> str:
    """Name the ends of records that a candidate predicts better than the chosen one."""
    better = [f"{where} by {gain:.0f}" for gain, where in _at_ends(score, chosen)
              if gain > SMALLEST_GAIN and where]  # fmt: skip
    return f"; it extrapolates better to {', '.join(better)} nats" if better else ""


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
    name = score.loo.names[np.flatnonzero(score.loo.interior)[block]]
    return (
        f"; one block decides, {name} (elpd {gained[block]:+.1f}): the others "
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
