"""Steady stretch against voltage, and where it ends."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import short

SCOPE = "study"
ANALYSIS = "pull_in"
TITLE = "Steady stretch and pull-in"
CAPTION = (
    "Left: stretch of the near equilibrium against voltage, as far as at least half of the draws "
    "have one (median, interval of the draws), and the stretch at the end of each step record, "
    "which still creeps. Right: voltage at which the near equilibrium ends, median and interval; "
    "beyond the records' voltages (dotted) it rests on the springs' law and the prior of the Gent "
    "limit. Above each point the share of draws whose branch folds there, which is pull-in; in "
    "the others the stretch reaches breakdown or the springs lock up."
)
HALF = 0.5


def draw(results: StudyResults) -> list[Figure]:
    """Two panels."""
    found = results.analysis(ANALYSIS)
    if found is None:
        return []
    steady, ends = found.curves["steady_stretch"], found.tables["pull_in"]
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 2.5 + style.HEADER), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _steady(left, steady)
    _ends(right, ends, float(steady["record_voltage"].max()) / 1e3 if steady["record"].size else 0)
    entries = panels.handles(steady, measured=False)
    if steady["record"].size:
        last = short(float(steady["record_duration"].max()), 3)
        entries.insert(
            0,
            Line2D(
                [], [], color=style.BLACK, marker="o", markersize=3, linestyle="none",
                label=f"record at its end, {last} s",
            ),
        )  # fmt: skip
    panels.legend_below(figure, entries, 5)
    return [figure]


def _steady(ax: Axes, steady: xr.Dataset) -> None:
    volts = steady["voltage"].values / 1e3
    for k in range(steady["candidate"].size):
        shown = steady["share"].values[k] >= HALF
        panels.draw_candidate(ax, volts[shown], steady["stretch"].values[k][:, shown], k)
    ax.plot(steady["record_voltage"].values / 1e3, steady["record_stretch"].values, "o",
            color=style.BLACK, markersize=3, zorder=5)  # fmt: skip
    ax.set_xlabel("voltage (kV)")
    ax.set_ylabel("steady stretch")
    ax.set_xlim(left=0.0)


def _ends(ax: Axes, ends: pd.DataFrame, highest: float) -> None:
    for k, (_, row) in enumerate(ends.iterrows()):
        reach = [[row["pull_in_kV"] - row["pull_in_q05"]], [row["pull_in_q95"] - row["pull_in_kV"]]]
        ax.errorbar(row["pull_in_kV"], k, xerr=np.abs(reach), fmt=panels.marker(k), capsize=2,
                    color=panels.colour(k), elinewidth=0.9)  # fmt: skip
        ax.text(row["pull_in_kV"], k - 0.18, f"{short(row['fold_percent'], 2)} % fold",
                ha="center", va="bottom", fontsize=6.0, color=style.GREY)  # fmt: skip
    if highest:
        ax.axvline(highest, color=style.GREY, linestyle=":", linewidth=0.8)
    ax.set_yticks(range(len(ends)), ends["candidate"])
    ax.set_ylim(len(ends) - 0.5, -0.6)
    ax.set_xlabel("end of the near equilibrium (kV)")
