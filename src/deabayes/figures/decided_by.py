"""Who decided a number of a posterior, the prior or the data, in words."""

from __future__ import annotations

from collections.abc import Mapping

from deabayes.posteriors.sensitivity import SENSITIVE

SMALLEST_CONTRACTION = 0.1
SET_BY_PRIOR = "set by the prior"
MOVED_BY_PRIOR = "moved by the prior"
MOVED_BY_BOTH = "moved by prior and data"


def in_words(row: Mapping[str, float]) -> str:
    """The words for a row of summary.csv; empty where the data decided, or it is not known.

    Contraction alone does not tell that the prior set a number: data may shift a posterior
    and leave it as wide as the prior. So where the likelihood's sensitivity is known, it has
    to be small. Files without sensitivities (NaN or no column) go by contraction.
    """
    prior = float(row.get("prior_sensitivity", float("nan")))
    likelihood = float(row.get("likelihood_sensitivity", float("nan")))
    if row["contraction"] < SMALLEST_CONTRACTION and not likelihood >= SENSITIVE:
        return SET_BY_PRIOR
    if not prior >= SENSITIVE:
        return ""
    if likelihood >= SENSITIVE:
        return MOVED_BY_BOTH
    return MOVED_BY_PRIOR if likelihood < SENSITIVE else ""
