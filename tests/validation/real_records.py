"""The table docs/validation/real_records.csv from the results of the studies on real records.

DEABAYES_DATA=... make && python -m tests.validation.real_records results
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from deabayes.posteriors.storage import read_tree
from tests.validation import rows


def row(posterior: Path) -> dict[str, object]:
    """One candidate: convergence, errors and coverage by role, verdict."""
    folder, study = posterior.parent, posterior.parent.parent
    errors = pd.read_csv(folder / "errors.csv")
    tree = read_tree(posterior)
    convergence = json.loads(tree.attrs["convergence"])
    comparison = pd.read_csv(study / "comparison.csv").set_index("candidate")
    held_out = errors[errors["role"] == "validate"]
    triangles = held_out[held_out["protocol"] == "load_unload"]
    calibrated = errors[errors["role"] == "calibrate"]

    def mean(table: pd.DataFrame, column: str, digits: int) -> float | str:
        return round(float(table[column].mean()), digits) if len(table) else ""

    return {
        "study": study.name,
        "candidate": folder.name,
        "converged": "yes" if convergence["converged"] else "NO",
        "R-hat": round(convergence["r_hat_max"], 4),
        "e_rms calibrated [%]": mean(calibrated, "e_rms_percent", 2),
        "e_rms held-out load-unload [%]": mean(triangles, "e_rms_percent", 2),
        "90 % band covers, held-out load-unload": mean(triangles, "coverage_90", 2),
        "e_rms all held out [%]": mean(held_out, "e_rms_percent", 2),
        "log evidence": round(float(comparison.loc[folder.name, "log_evidence"]), 1),
        "verdict": comparison.loc[folder.name, "verdict"],
        "deabayes": version("deabayes"),
    }


def finished(posterior: Path) -> bool:
    """Whether a candidate on records that are not simulated was predicted with and compared."""
    comparison = posterior.parent.parent / "comparison.csv"
    return (
        posterior.with_name("errors.csv").exists()
        and comparison.exists()
        and posterior.parent.name in set(pd.read_csv(comparison)["candidate"])
        and read_tree(posterior).attrs["provenance"] != "simulated"
    )


def main() -> None:
    results = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
    posteriors = sorted(results.glob("*/*/posterior.nc"))
    table = [row(path) for path in posteriors if finished(path)]
    rows.write_table(rows.OUTPUT / "real_records.csv", table)


if __name__ == "__main__":
    main()
