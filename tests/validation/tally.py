"""How often the right model order was picked, and whether a conflict of criteria went unflagged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd

from deabayes.comparison.blocks import BlockLoo
from deabayes.comparison.decision import Decision, Score, decide, is_favoured
from tests.validation import rows
from tests.validation.order_signal import SHOWN

OUTCOMES = ("right", "not resolved", "wrong", "no verdict")


def outcome(decision: Decision, right: str) -> str:
    """Return one of `OUTCOMES` for a decision.

    "Not resolved" is any choice with a flag. "No verdict" means that too few candidates converged.
    """
    if decision.chosen is None:
        return "no verdict"
    if decision.unresolved:
        return "not resolved"
    return "right" if decision.chosen == right else "wrong"


def unflagged_conflict(scores: Sequence[Score], decision: Decision) -> bool:
    """Whether a candidate was chosen without a flag, although another one is not worse.

    The chosen one must win against every smaller candidate, and no larger one may win, or even
    conflict, against it.
    """
    if decision.chosen is None or decision.unresolved:
        return False
    ranked = {s.candidate: s for s in scores if s.loo is not None}
    chosen = ranked.pop(decision.chosen)
    return not all(is_favoured(chosen, other) for other in ranked.values())


def single_picks(scores: Sequence[Score]) -> Mapping[str, str]:
    """The best candidate by each criterion alone, among those that converged."""
    ranked = [s for s in scores if s.loo is not None]
    if not ranked:
        return dict.fromkeys(("evidence", "bic", "elpd"), "")
    return {
        "evidence": max(ranked, key=lambda s: s.log_evidence).candidate,
        "bic": min(ranked, key=lambda s: s.bic).candidate,
        "elpd": max(ranked, key=lambda s: s.loo.elpd if s.loo else float("-inf")).candidate,
    }


def scores_of(row: Mapping[str, object]) -> list[Score]:
    """The candidates' scores that a row of `order_selection` holds."""
    orders = [int(name.split(":")[1]) for name in row if name.startswith("terms:")]
    return [_score(row, order) for order in orders]


def _score(row: Mapping[str, object], order: int) -> Score:
    terms = np.array(str(row[f"terms:{order}"]).split(), dtype=float)
    return Score(
        candidate=candidate(row, order),
        order=order,
        n_parameters=int(str(row[f"parameters:{order}"])),
        converged=bool(terms.size),
        log_evidence=float(str(row[f"log_evidence:{order}"])),
        log_evidence_mcse=float(str(row[f"mcse:{order}"])),
        bic=float(str(row[f"bic:{order}"])),
        leave_one_experiment_out=float("nan"),
        loo=BlockLoo(terms, np.zeros_like(terms)) if terms.size else None,
    )


def candidate(row: Mapping[str, object], order: int) -> str:
    """Name of a candidate of the row's family."""
    return f"{row['family']}_{order}"


def verdict(row: Mapping[str, object]) -> dict[str, object]:
    """What the shipped rule, and each criterion alone, makes of a row.

    Right is the true order, or the largest candidate where the truth has more units.
    """
    scores = scores_of(row)
    decision = decide(scores)
    right = candidate(row, min(int(str(row["truth"])), max(score.order for score in scores)))
    return {
        "right": right,
        "outcome": outcome(decision, right),
        "chosen": decision.chosen,
        "unresolved": " ".join(decision.unresolved),
        "unflagged_conflict": unflagged_conflict(scores, decision),
        "all_converged": all(score.converged for score in scores),
        **{f"best_{criterion}": pick for criterion, pick in single_picks(scores).items()},
    }


def write(folder: Path) -> list[str]:
    """Write order_selection.csv; return what is missing."""
    files = sorted(folder.glob("order_selection_*.csv"))
    if not files:
        return ["order_selection_*.csv"]
    rows.write_table(
        folder / "order_selection.csv", tally(chain.from_iterable(map(rows.read, files)))
    )
    return []


def tally(replicates: Iterable[Mapping[str, object]]) -> list[rows.Row]:
    """Return a row per family, world and truth: picks, share right, flags, conflicts.

    Parameters
    ----------
    replicates : the rows that `order_selection` stores, as `rows.read` gives them.
    """
    judged = pd.DataFrame([{**row, **verdict(row)} for row in replicates])
    groups = judged.groupby(["family", "world", "truth"], sort=True)
    return [_tallied(keys, group) for keys, group in groups]


def _tallied(keys: tuple[str, str, str], group: pd.DataFrame) -> rows.Row:
    family, world, truth = keys
    counts = {outcome: int((group["outcome"] == outcome).sum()) for outcome in OUTCOMES}
    judged = group[group["outcome"] != "no verdict"]
    decided = counts["right"] + counts["wrong"]
    shown = judged[judged["signal"].astype(float) >= SHOWN]
    shown_right = int((shown["outcome"] == "right").sum())
    picks = group["chosen"].value_counts()
    right = group["right"].iloc[0]
    return {
        "family": family,
        "world": world,
        "true units": truth,
        "right pick": right,
        "replicates": len(group),
        **counts,
        "picks": ", ".join(f"{name}: {count}" for name, count in sorted(picks.items())),
        "share right of all judged": share(counts["right"], len(judged)),
        "last unit is shown": len(shown),
        "share right of these": share(shown_right, len(shown)),
        "share right of those decided": share(counts["right"], decided),
        **{
            f"best {criterion} right": share(
                int((judged[f"best_{criterion}"] == right).sum()), len(judged)
            )
            for criterion in ("evidence", "bic", "elpd")
        },
        "unflagged conflicts": int(group["unflagged_conflict"].sum()),
        "every candidate converged": int(group["all_converged"].sum()),
    }


def share(part: int, whole: int) -> str:
    """A share with two digits; empty of nothing."""
    return f"{part / whole:.2f}" if whole else ""
