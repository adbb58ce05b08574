"""Table and figure of NIST's regression sets, of whatever has been run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from tests.validation import nist, nist_reference
from tests.validation.nist_models import CURVES
from tests.validation.nist_sets import certified
from tests.validation.rows import Row, write_table

TABLE, FIGURE = "nist_summary.csv", "nist.png"
SMALL_SHIFT, SMALL_RATIO = 0.1, 0.05
"""A set bends if its exact mean is off by more (in sds), or its sd (relative)."""
FEWEST_EFFECTIVE = 10000
"""Draws behind a reference that is compared with."""


def write(folder: Path) -> list[str]:
    """Write table and figure of what has been run; return what is missing."""
    missing = [name for name in (nist.FILE, nist_reference.FILE) if not (folder / name).exists()]
    if missing:
        return missing
    parameters = merged(folder)
    names = list(parameters["set"].unique())
    table = [summary(name, parameters[parameters["set"] == name]) for name in names]
    write_table(folder / TABLE, table)
    draw(parameters, folder / FIGURE)
    return [f"{nist.FILE}: {name}" for name in CURVES if name not in names]


def merged(folder: Path) -> pd.DataFrame:
    """One row per parameter, the reference's columns with `exact_` before them, easiest first.

    Ratios of sds are over those of the Student-t that a linear response would have.
    """
    exact = pd.read_csv(folder / nist_reference.FILE).iloc[:, :5]
    exact = exact.rename(columns=lambda c: c if c in ("set", "parameter") else f"exact_{c}")
    rows = pd.read_csv(folder / nist.FILE).merge(exact, on=["set", "parameter"], how="left")
    rows["ratio"] = rows["sd_ratio"] / rows["expected_sd_ratio"]
    rows["exact_ratio"] = rows["exact_sd_ratio"] / rows["expected_sd_ratio"]
    few = ~(rows["exact_effective_draws"] >= FEWEST_EFFECTIVE)
    rows.loc[few, ["exact_difference_sd", "exact_sd_ratio", "exact_ratio"]] = np.nan
    levels = ["lower", "average", "higher"]
    rows["level"] = [levels.index(certified(name).difficulty) for name in rows["set"]]
    rows["place"] = [list(CURVES).index(name) for name in rows["set"]]
    return rows.sort_values(["level", "place", "parameter"], kind="stable")


def summary(name: str, rows: pd.DataFrame) -> Row:
    """The parameter that is worst in each respect."""
    nist_set, known = certified(name), bool(rows["exact_ratio"].notna().all())
    to_exact = (rows["difference_sd"] - rows["exact_difference_sd"]) / rows["exact_sd_ratio"]
    # Digits that NIST does not print: up to 0.2 sds for Lanczos1, below 1e-5 for other sets.
    rounding = (nist_set.least_squares - nist_set.estimates) / nist_set.sds
    printed = dict(zip(nist_set.names, rounding, strict=True))
    shifts = rows["exact_difference_sd"] - rows["parameter"].map(printed)
    bent = (shifts.abs() > SMALL_SHIFT) | ((rows["exact_ratio"] - 1.0).abs() > SMALL_RATIO)
    bends = bool(bent.any())
    return {
        "set": name,
        "difficulty": nist_set.difficulty,
        "n - p": nist_set.freedom,
        "converged": "yes" if rows["converged"].all() else "NO",
        "tau": f"{rows['tau'].max():.0f}",
        "CPU s": f"{rows['cpu_seconds'].max():.0f}",
        "bends": ("yes" if bends else "no") if known else "not known",
        "mean - certified [sd]": f"{farthest(rows['difference_sd'], 0.0):.3f}",
        "sd / Student-t's": f"{farthest(rows['ratio'], 1.0):.3f}",
        "mean - exact [sd]": f"{farthest(to_exact, 0.0):.3f}" if known else "-",
        "sd / exact": f"{farthest(rows['ratio'] / rows['exact_ratio'], 1.0):.3f}" if known else "-",
        "error of the mean [sd]": f"{rows['mcse_sd'].max():.3f}",
        "seed": rows["seed"].iloc[0],
        "deabayes": rows["deabayes"].iloc[-1],
    }


def farthest(values: pd.Series, centre: float) -> float:
    """The value farthest from the centre."""
    return float(values.iloc[int(np.argmax(np.abs(values.to_numpy() - centre)))])


def draw(rows: pd.DataFrame, path: Path) -> None:
    """Per parameter: shift of the mean and ratio of the sds, sampled and exact.

    What is beyond an axis is drawn at its end.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from deabayes.figures import style

    names = list(rows["set"].unique())
    places, ticks = positions(rows, names)
    panels = (
        ("difference_sd", 0.0, SMALL_SHIFT, "mean - certified [certified sd]", (-8.0, 8.0)),
        ("ratio", 1.0, SMALL_RATIO, "sd / that of the Student-t", (0.7, 4.0)),
    )
    with style.applied():
        figure, axes = plt.subplots(2, 1, figsize=(7.2, 5.4), sharex=True, layout="constrained")
        axes[0].set_yscale("symlog", linthresh=SMALL_SHIFT)
        axes[1].set_yscale("log")
        for axis, (column, centre, small, label, ends) in zip(axes, panels, strict=True):
            axis.set_ylim(*ends)
            axis.axhspan(centre - small, centre + small, color=style.LIGHT_GREY, lw=0)
            axis.plot(
                places, rows[f"exact_{column}"], "_", ms=6, mew=1.2, color=style.VERMILLION,
                label="exact for the curved response",
            )  # fmt: skip
            for good, face, told in ((1, style.BLUE, "sampled"), (0, "white", "not converged")):
                at = (rows["converged"] == good).to_numpy()
                if not at.any():  # an empty line without clipping makes the layout collapse
                    continue
                shown = rows[column].clip(*ends)
                axis.plot(
                    places[at],
                    shown[at],
                    "o",
                    ms=3,
                    mfc=face,
                    mec=style.BLUE,
                    label=told,
                    clip_on=False,
                )
            for _, edge in ticks[:-1]:
                axis.axvline(edge, color=style.LIGHT_GREY, lw=0.5)
            axis.set_ylabel(label)
        axes[1].set_xticks([middle for middle, _ in ticks], names, rotation=90)
        axes[1].set_yticks([0.7, 1.0, 2.0, 4.0], ["0.7", "1", "2", "4"])
        axes[1].minorticks_off()
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
        figure.savefig(path, dpi=160)
        plt.close(figure)


def positions(rows: pd.DataFrame, names: list[str]) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Where each parameter stands, and each set's middle and right edge."""
    places, ticks, start = [], [], 0.0
    for name in names:
        count = int((rows["set"] == name).sum())
        places.append(start + np.arange(count))
        ticks.append((start + (count - 1) / 2, start + count + 0.5))
        start += count + 2.0
    return np.concatenate(places), ticks
