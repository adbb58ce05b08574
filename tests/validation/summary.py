"""Tables and figures of docs/validation from the replicates that the checks stored.

python -m tests.validation.summary

What has not been run yet is named, and the page says "not measured yet" in its place.
"""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from tests.validation import goals, membrane_summary, nist_summary, rank_figure, recovery_summary
from tests.validation.calibration import NARROW, OUTPUT, RANKS, SEED
from tests.validation.ecdf import inside


def names_of(replicates: pd.DataFrame) -> list[str]:
    """The parameters that were ranked."""
    return [name.removeprefix("covered:") for name in replicates if name.startswith("covered:")]


def family_table(candidate: str, replicates: pd.DataFrame) -> pd.DataFrame:
    """One row per parameter: inside the band, the negative control, 90 % coverage."""
    rows = [
        {
            "model": candidate,
            "parameter": name,
            "replicates": len(replicates),
            "ranks in 95 % band": "yes" if inside(replicates[name], RANKS + 1) else "NO",
            "coverage of 90 % interval": round(float(replicates[f"covered:{name}"].mean()), 3),
            f"control, draws narrowed to {NARROW}": "inside (control failed)"
            if inside(replicates[f"narrow:{name}"], RANKS + 1)
            else "leaves the band",
            "seed": SEED,
            "deabayes": version("deabayes"),
        }
        for name in names_of(replicates)
    ]
    return pd.DataFrame(rows)


def draw(candidate: str, replicates: pd.DataFrame, path: Path) -> None:
    """ECDF of the ranks, and of the control's, minus the uniform one."""
    ranks = {
        name: {
            "posterior ranks": replicates[name].to_numpy(),
            f"control: draws narrowed to {NARROW}": replicates[f"narrow:{name}"].to_numpy(),
        }
        for name in names_of(replicates)
    }
    title = f"{candidate}: {len(replicates)} simulated data sets"
    rank_figure.draw(title, ranks, RANKS + 1, path)


def calibration(folder: Path) -> list[str]:
    """Write calibration.csv and its figures; say what is missing."""
    tables = []
    for path in sorted(folder.glob("calibration_*.csv")):
        candidate = re.sub("^calibration_", "", path.stem)
        replicates = pd.read_csv(path).sort_values("replicate")
        tables.append(family_table(candidate, replicates))
        draw(candidate, replicates, folder / f"calibration_{candidate}.png")
    if not tables:
        return ["calibration_*.csv"]
    table = pd.concat(tables, ignore_index=True)
    table.to_csv(folder / "calibration.csv", index=False)
    failed = int(np.sum(table["ranks in 95 % band"] != "yes"))
    print(table.to_string(index=False))
    print(f"{failed} of {len(table)} parameters outside their band")
    return []


def main() -> None:
    missing = [
        *calibration(OUTPUT),
        *membrane_summary.write(OUTPUT),
        *recovery_summary.write(OUTPUT),
        *nist_summary.write(OUTPUT),
        *goals.write(OUTPUT),
    ]
    for name in missing:
        print(f"not measured yet: {OUTPUT / name}")


if __name__ == "__main__":
    main()
