"""Which model order: the rows of the comparison, and what its verdict cannot exclude."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from deabayes.figures.noise_share import sizes
from deabayes.figures.results import StudyResults
from deabayes.quantities import fixed, significant


def order_rows(study: StudyResults) -> list[dict[str, Any]]:
    """Rows of the order comparison."""
    if study.comparison is None:
        return []
    return [
        {
            "candidate": name,
            "shown": name == study.recommended.name,
            "n_parameters": int(row["n_parameters"]),
            "log_evidence": _with_error(row["log_evidence"], row["log_evidence_mcse"]),
            "log_evidence_nested": _with_error(
                row.get("log_evidence_nested", np.nan), row.get("log_evidence_nested_error", np.nan)
            ),
            "bic": _fixed(row["bic"]),
            "elpd": _with_error(row["elpd_block_loo"], row["elpd_block_loo_se"]),
            "left_out": _fixed(row["elpd_leave_one_experiment_out"]),
            "k_hat": _fixed(row["worst_k_hat"], 2),
            "converged": bool(row["converged"]),
            "verdict": row["verdict"],
        }
        for name, row in study.comparison.iterrows()
    ]


def asked_for_nested(study: StudyResults) -> bool:
    """Whether a candidate's evidence was checked by nested sampling."""
    table = study.comparison
    return table is not None and bool(table.get("log_evidence_nested", pd.Series()).notna().any())


def may_hide(study: StudyResults) -> str:
    """How small a further unit the candidate's correlated noise would take for itself.

    Empty where nothing is compared, or where correlated noise is below white noise everywhere.
    """
    if study.comparison is None or len(study.comparison) < 2:
        return ""
    found = sizes(study.recommended)
    above = {
        name: each["correlated"]
        for name, each in found.items()
        if each.get("correlated", 0.0) > each.get("white", 0.0)
    }
    if not above:
        return ""
    name = max(above, key=lambda record: above[record])
    white = found[name].get("white", 0.0)
    beside = f", beside white noise of {significant(100 * white, 2)} %" if white else ""
    most = ", the most of its records" if len(found) > 1 else ""
    return (
        f"Correlated noise takes what {study.recommended.name} leaves: "
        f"{significant(100 * above[name], 2)} % of the range in {name}{most}{beside}. A further "
        "unit that adds less than that may be hidden in it. The verdict says which units these "
        "records need, not that there are no others."
    )


def _fixed(value: float, decimals: int = 1) -> str:
    return fixed(value, decimals) if np.isfinite(value) else "–"


def _with_error(value: float, error: float) -> str:
    return _fixed(value) + (f" ± {error:.1f}" if np.isfinite(error) and np.isfinite(value) else "")
