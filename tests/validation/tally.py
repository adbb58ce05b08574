"""How often the right model order was picked, where the records show the last unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd

from deabayes.comparison.blocks import BlockLoo
from deabayes.comparison.decision import Decision, Score, decide
from deabayes.report.words import SMALL_GAIN, explained
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
    ends = tuple(end == "1" for end in str(row["ends"]).split())
    return Score(
        candidate=candidate(row, order),
        order=order,
        n_parameters=int(str(row[f"parameters:{order}"])),
        converged=bool(terms.size),
        log_evidence=float(str(row[f"log_evidence:{order}"])),
        log_evidence_mcse=float(str(row[f"mcse:{order}"])),
        bic=float(str(row[f"bic:{order}"])),
        loo=BlockLoo(terms, np.zeros_like(terms), ends=ends) if terms.size else None,
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
        "surplus": _is_surplus(row, scores, decision),
        "cautioned": _is_cautioned(row, scores, decision),
        **{f"best_{criterion}": pick for criterion, pick in single_picks(scores).items()},
    }


def _is_surplus(row: Mapping[str, object], scores: Sequence[Score], decision: Decision) -> bool:
    """Whether a candidate with more units than the truth was chosen without a flag."""
    order = next((s.order for s in scores if s.candidate == decision.chosen), 0)
    return order > int(str(row["truth"])) and not decision.unresolved


def _is_cautioned(row: Mapping[str, object], scores: Sequence[Score], decision: Decision) -> bool:
    """Whether the report says that a smooth error may look like the chosen order's last unit.

    The root mean square error of a fit, a share of the range, is here that of its noise model.
    """
    ranked = sorted(s.order for s in scores if s.converged)
    order = next((s.order for s in scores if s.candidate == decision.chosen), 0)
    if order not in ranked[1:]:
        return False
    theirs, mine = (_mean_square(row, o) for o in (ranked[ranked.index(order) - 1], order))
    return 0.0 < 100.0 * explained(theirs, mine) < SMALL_GAIN


def _mean_square(row: Mapping[str, object], order: int) -> float:
    return float(sum(float(str(row[f"{part}:{order}"])) ** 2 for part in ("correlated", "white")))


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
    """Return a row per family, world and truth: specimens, outcomes, surplus units.

    Parameters
    ----------
    replicates : the rows that `order_selection` stores, as `rows.read` gives them.
    """
    judged = pd.DataFrame([{**row, **verdict(row)} for row in replicates])
    groups = judged.groupby(["family", "world", "truth"], sort=True)
    return [_tallied(keys, group) for keys, group in groups]


def _tallied(keys: tuple[str, str, str], group: pd.DataFrame) -> rows.Row:
    family, world, truth = keys
    shown = group[group["signal"].astype(float) >= SHOWN]
    judged = shown[shown["outcome"] != "no verdict"]
    counts = {outcome: int((shown["outcome"] == outcome).sum()) for outcome in OUTCOMES}
    return {
        "family": family,
        "world": world,
        "true units": truth,
        "specimens": len(group),
        "surplus unit": int(group["surplus"].sum()),
        "last unit is shown": len(shown),
        **counts,
        "wrong without caution": int((~shown["cautioned"] & (shown["outcome"] == "wrong")).sum()),
        "right with caution": int((shown["cautioned"] & (shown["outcome"] == "right")).sum()),
        "share right": share(counts["right"], len(judged)),
        **{
            f"right by {criterion} alone": share(
                int((judged[f"best_{criterion}"] == judged["right"]).sum()), len(judged)
            )
            for criterion in ("evidence", "bic", "elpd")
        },
    }


def share(part: int, whole: int) -> str:
    """A share with two digits; empty of nothing."""
    return f"{part / whole:.2f}" if whole else ""
