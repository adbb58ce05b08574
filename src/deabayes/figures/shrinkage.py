"""Estimates of every specimen, from its own records and with the population as prior."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from deabayes.figures import panels, style
from deabayes.figures.results import PopulationResults
from deabayes.quantities import DisplayUnit, display_unit, symbol_text

SCOPE = "population"
TITLE = "Specimens and their population"
CAPTION = (
    "Median and 90 % interval of every specimen: from its own records (circles), and with the "
    "population as prior (diamonds). The less a specimen's records say, the nearer its diamond "
    "lies to the population's mean (dashed; its 90 % interval is shaded darker). A new specimen "
    "lies in the light band with 90 % probability. Hollow diamonds: few of a specimen's own draws "
    "agree with the population, or its posterior has not converged."
)
MOST_ACROSS = 3
LEGIBLE_DECADES = 1.0


def draw(results: PopulationResults) -> list[Figure]:
    """Return one panel per parameter, with one row per specimen."""
    table, names = results.shrinkage, results.parameters
    return [_sheet(results, table, each) for each in panels.batches(names, 2 * MOST_ACROSS)]


def _sheet(results: PopulationResults, table: pd.DataFrame, names: Sequence[str]) -> Figure:
    members = list(dict.fromkeys(table["study"]))
    across = min(len(names), MOST_ACROSS)
    down = -(-len(names) // across)
    height = down * (0.19 * (len(members) + 1) + 0.55) + 0.5
    width = 1.0 if across > 1 else 0.7
    figure, axes = panels.cells(len(names), across, height, width, sharey=True)
    for ax, name in zip(axes, names, strict=True):
        _panel(ax, results, table[table["parameter"] == name], name)
        ax.set_yticks(range(len(members)), members, fontsize=6.0)
        ax.set_ylim(len(members) - 0.4, -0.6)
    handles = [
        panels.key("by itself", style.GREY, marker="o", linestyle="-"),
        panels.key("with the population", style.BLUE, marker="D", linestyle="-"),
        panels.key("population's mean", style.VERMILLION, linestyle="--"),
        Patch(color=style.VERMILLION, alpha=0.28, linewidth=0, label="mean, 90 %"),
        Patch(color=style.VERMILLION, alpha=0.12, linewidth=0, label="new specimen, 90 %"),
    ]
    panels.legend_below(figure, handles, columns=5)
    return figure


def _panel(ax: Axes, results: PopulationResults, rows: pd.DataFrame, name: str) -> None:
    summary, label = results.summary, results.new_specimen.label(name)
    unit = display_unit(label["unit"], rows["median"].abs().median(), name)
    new, mean = summary.loc[name], summary.loc[f"mean_{name}"]
    for row, alpha in ((new, 0.12), (mean, 0.28)):
        band = [row[bound] / unit.factor for bound in ("q05", "q95")]
        ax.axvspan(*band, color=style.VERMILLION, alpha=alpha, linewidth=0)
    ax.axvline(mean["median"] / unit.factor, color=style.VERMILLION, linestyle="--", linewidth=0.8)
    for place, (_, row) in enumerate(rows.iterrows()):
        sound = bool(row["reliable"] and row["converged"])
        _interval(ax, row, "", place - 0.14, unit, style.GREY, "o", True)
        _interval(ax, row, "shrunken_", place + 0.14, unit, style.BLUE, "D", sound)
    ends = np.array([rows["q05"].min(), rows["q95"].max()]) / unit.factor
    if ends[0] > 0 and np.log10(ends[1] / ends[0]) > LEGIBLE_DECADES:
        panels.logarithmic(ax, ends, 4)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.set_xlabel(symbol_text(name, label["symbol"]) + unit.suffix)


def _interval(
    ax: Axes, row: pd.Series, prefix: str, y: float, unit: DisplayUnit, colour: str, marker: str,
    filled: bool,
) -> None:  # fmt: skip
    median, low, high = (row[prefix + q] / unit.factor for q in ("median", "q05", "q95"))
    ax.plot([low, high], [y, y], color=colour, linewidth=1.0, solid_capstyle="butt")
    face = colour if filled else "white"
    ax.plot([median], [y], marker, color=colour, markersize=3.2, markerfacecolor=face)
