"""Tables and figures of docs/validation from the replicates that `calibration` stored.

python -m tests.validation.summary
"""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from tests.validation.calibration import NARROW, OUTPUT, RANKS, SEED
from tests.validation.ecdf import band, ecdf, inside

BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#999999"


def family_table(candidate: str, replicates: pd.DataFrame) -> pd.DataFrame:
    """One row per parameter: inside the band, the negative control, 90 % coverage."""
    names = [name.removeprefix("covered:") for name in replicates if name.startswith("covered:")]
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
        for name in names
    ]
    return pd.DataFrame(rows)


def draw(candidate: str, replicates: pd.DataFrame, path: Path) -> None:
    """ECDF of the ranks minus the uniform one, with the simultaneous band."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from deabayes.figures import style

    names = [name.removeprefix("covered:") for name in replicates if name.startswith("covered:")]
    limits = band(len(replicates), RANKS + 1)
    columns = 4
    rows = -(-len(names) // columns)
    with style.applied():
        figure, axes = plt.subplots(
            rows,
            columns,
            figsize=(7.2, 1.6 * rows + 0.9),
            sharex=True,
            sharey=True,
            squeeze=False,
            layout="constrained",
        )
        for axis in axes.flat[len(names) :]:
            axis.set_visible(False)
        for axis, name in zip(axes.flat, names, strict=False):
            axis.fill_between(
                limits.points,
                limits.lower - limits.points,
                limits.upper - limits.points,
                color=GREY,
                alpha=0.3,
                lw=0,
                label="95 % simultaneous band",
            )
            for column, colour, label in (
                (name, BLUE, "posterior ranks"),
                (f"narrow:{name}", ORANGE, f"control: draws narrowed to {NARROW}"),
            ):
                difference = ecdf(replicates[column].to_numpy(), RANKS + 1) - limits.points
                axis.plot(limits.points, difference, color=colour, label=label)
            axis.set_title(name, fontsize=8)
        figure.supxlabel("rank / number of draws", fontsize=8)
        figure.supylabel("ECDF of ranks - uniform", fontsize=8)
        figure.suptitle(f"{candidate}: {len(replicates)} simulated data sets", fontsize=9)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False
        )
        figure.savefig(path, dpi=160)
        plt.close(figure)


def main() -> None:
    tables = []
    for path in sorted(OUTPUT.glob("calibration_*.csv")):
        candidate = re.sub("^calibration_", "", path.stem)
        replicates = pd.read_csv(path).sort_values("replicate")
        tables.append(family_table(candidate, replicates))
        draw(candidate, replicates, OUTPUT / f"calibration_{candidate}.png")
    table = pd.concat(tables, ignore_index=True)
    table.to_csv(OUTPUT / "calibration.csv", index=False)
    failed = int(np.sum(table["ranks in 95 % band"] != "yes"))
    print(table.to_string(index=False))
    print(f"{failed} of {len(table)} parameters outside their band")


if __name__ == "__main__":
    main()
