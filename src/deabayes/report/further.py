"""Which experiment to do next, in words and as a table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from deabayes.figures.results import StudyResults

SURE, MAY_FAIL = 0.9, 0.01
"""Probability of deciding rightly that is called telling, and share of draws without a response
from which an experiment is not proposed."""
ROUNDING = 0.005
"""Nats that make no difference."""


def sentence(study: StudyResults) -> str:
    """The best further experiment in plain words; empty where there is nothing to tell apart."""
    table = study.further_experiments
    if table is None or ", " not in str(table["candidates"].iloc[0]):
        return ""
    names = str(table["candidates"].iloc[0]).split(", ")
    question = f"tell {names[0]} from {_either(names[1:])}"
    safe = table[table["failed_share"] <= MAY_FAIL]
    telling = safe[
        safe["information_candidate_nats"] > 2.0 * safe["information_candidate_error_nats"]
    ]
    if telling.empty:
        text = f"{_none_of(table)} be expected to {question}"
        return text + (", save some that the specimen may not survive." if _lost(table) else ".")
    best = _preferred(telling)
    probability = f"{best['probability_right']:.2f}"
    outside = best["extrapolation"]
    caution = f" It is an extrapolation ({outside})." if isinstance(outside, str) else ""
    if best["probability_right"] < SURE:
        return (
            f"{_none_of(table)} surely {question}; the best, "
            f"{_said(best)}, would decide rightly with probability {probability} "
            f"({1.0 / len(names):.2f} is guessing).{caution}"
        )
    return (
        f"{_sentence_case(_said(best))} would be expected to {question}, deciding rightly with "
        f"probability {probability}.{caution}"
    )


def further_rows(study: StudyResults) -> list[dict[str, Any]]:
    """The table of the page, the most telling experiment first."""
    table = study.further_experiments
    if table is None:
        return []
    names = str(table["candidates"].iloc[0]).split(", ")
    return [
        {
            "experiment": row["experiment"],
            "what": row["what"] + (", held-out record" if row["held_out"] else ""),
            "probability": _number(row["probability_right"], row["probability_right_error"]),
            "candidate": _number(
                row["information_candidate_nats"], row["information_candidate_error_nats"]
            ),
            "parameters": [
                f"{name} {_number(row[f'information_{name}_nats'], np.nan, 1)}" for name in names
            ],
            "cautions": _cautions(row),
        }
        for _, row in table.iterrows()
    ]


def _preferred(telling: pd.DataFrame) -> pd.Series:
    """Of those as telling as the best, within errors: one already measured, one in range."""
    nats, error = telling["information_candidate_nats"], telling["information_candidate_error_nats"]
    margin = np.maximum(2.0 * np.hypot(error, error.iloc[0]), ROUNDING)
    equal = telling[nats >= nats.iloc[0] - margin]
    outside = equal["extrapolation"].map(lambda flag: isinstance(flag, str) and bool(flag))
    order = equal.assign(new=~equal["held_out"].astype(bool), outside=outside)
    return equal.loc[order.sort_values(["new", "outside"], kind="stable").index[0]]


def _none_of(table: pd.DataFrame) -> str:
    several = f"None of the {len(table)} experiments considered would"
    return several if len(table) > 1 else "The only experiment considered would not"


def _lost(table: pd.DataFrame) -> bool:
    risky = table[table["failed_share"] > MAY_FAIL]
    errors = risky["information_candidate_error_nats"]
    return bool((risky["information_candidate_nats"] > 2.0 * errors).any())


def _cautions(row: pd.Series) -> list[str]:
    found = [row["extrapolation"]] if isinstance(row["extrapolation"], str) else []
    if row["failed_share"] > 0.0:
        percent = f"{100 * row['failed_share']:.3g} %"
        found.append(
            f"{percent} of the draws have no response ({row['failure']}): the specimen may not "
            "survive it"
        )
    return found


def _said(row: pd.Series) -> str:
    kind = "the held-out record " if row["held_out"] else ""
    return f"{kind}{row['experiment']} ({row['what']})"


def _sentence_case(text: str) -> str:
    return text.replace("the held-out", "The held-out", 1)


def _either(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _number(value: float, error: float, decimals: int = 2) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{value:.{decimals}f}" + (f" ± {error:.{decimals}f}" if np.isfinite(error) else "")
