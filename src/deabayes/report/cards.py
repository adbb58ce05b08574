"""Cards of the first screen: order, checks, errors, five quantities and cautions of a study."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Any

import pandas as pd

from deabayes.faults import UserError
from deabayes.figures.results import CandidateResults, StudyResults
from deabayes.prediction.errors import missed, rejected
from deabayes.quantities import significant
from deabayes.report import tables, words
from deabayes.report.notices import REJECTING, TOO_NARROW, Notice
from deabayes.systems import system_class

QUANTITIES = 5
KINDS = ("material", "derived", "specimen")
NAMED = 4


def card(study: StudyResults, notices: Iterable[Notice]) -> dict[str, Any]:
    """Return the content of a study's card.

    Parameters
    ----------
    notices : of the study; only the serious ones are on the card.
    """
    best = study.recommended
    choice, how_sure = words.headline(study)
    outcomes = words.checks(study)
    return {
        "choice": choice,
        "how_sure": how_sure,
        "passed": [check.text for check in outcomes if not check.failed],
        "errors": errors(best),
        "parameters": [tables.parameter(best, name) for name in key_quantities(best)],
        "cautions": [(check.text, "") for check in outcomes if check.failed]
        + [(n.title, subjects(n)) for n in notices if _is_on_card(n, best.name)],
    }


def _is_on_card(notice: Notice, best: str) -> bool:
    """Whether a notice is serious and about the recommended candidate, and no failed check."""
    checked = notice.title in (REJECTING, TOO_NARROW)
    return notice.serious and notice.candidate in ("", best) and not checked


def key_quantities(results: CandidateResults) -> list[str]:
    """Names of the quantities that a reader wants first.

    These are the ones that the system names in `headline`, then material parameters and
    quantities of the specimen.
    """
    if results.summary is None:
        return []
    try:
        patterns = system_class(results.study.system).headline
    except UserError:  # a system of the user's own, whose file is not loaded here
        patterns = ()
    known = [name for name in results.names(*KINDS) if name in results.summary.index]
    first = [name for pattern in patterns for name in known if fnmatchcase(name, pattern)]
    others = [n for n in results.names("material", "specimen") if n in known]
    return list(dict.fromkeys([*first, *others]))[:QUANTITIES]


def errors(results: CandidateResults) -> list[dict[str, Any]]:
    """Rows of the errors on fitted and on held-out records; one row per role that has records."""
    table = results.errors
    if table is None:
        return []
    failing = {"calibrate": rejected(table), "validate": missed(table)}
    rows = []
    for role, text in (("calibrate", "fitted"), ("validate", "held out")):
        of_role = table[table["role"] == role]
        if len(of_role):
            rows.append(
                {
                    "records": f"{len(of_role)} {text}",
                    "e_rms": _mean_and(of_role["e_rms_percent"], "max"),
                    "coverage": _mean_and(100.0 * of_role["coverage_90"], "min"),
                    "failed": not failing[role].empty,
                }
            )
    return rows


def _mean_and(percent: pd.Series, worst: str) -> tuple[str, str]:
    """Mean in per cent, a dash if not known, and the worst record unless it is the same."""
    known = percent.dropna()
    if known.empty:
        return "–", ""
    mean, other = (
        f"{value:.0f} %" if worst == "min" else f"{significant(value, 2)} %"
        for value in (float(known.mean()), float(known.agg(worst)))
    )
    return mean, "" if mean == other else f"worst {other}"


def subjects(notice: Notice) -> str:
    """Records or parameters that a notice is about, as far as its sentences begin with them."""
    beginnings = [text.partition(": ")[0] for text in notice.details if ": " in text]
    parts = [part for beginning in beginnings for part in beginning.split(", ")]
    found = [part for part in dict.fromkeys(parts) if " " not in part]
    more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
    return ", ".join(found[:NAMED]) + more
