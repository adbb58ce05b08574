"""Which quantities the data determined, and which the prior still sets."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.posteriors.sensitivity import SENSITIVE, SET_BY_PRIOR, SMALLEST_CONTRACTION, in_words
from deabayes.quantities import symbol_text

SCOPE = "candidate"
TITLE = "What the data determined"
CAPTION = (
    "Left: contraction, the share of the prior's variance that the data removed (no bar: none, "
    "also where the posterior is the wider one); below 10 % (dashed) a number is set by the "
    "prior, unless more weight on the data still moves it. "
    "Middle: how far a number moves with the weight of the priors (diamonds) and of the data "
    "(circles), power-scaling sensitivity; up to 0.05 (dashed) is nothing to mention. Right: "
    "relative width of the posterior. Derived quantities, such as ratios, may be well known "
    "although no single parameter in them is."
)
COLOURS = {
    "material": style.BLUE,
    "specimen": style.ORANGE,
    "derived": style.GREEN,
    "noise": style.GREY,
}


def draw(results: CandidateResults) -> list[Figure]:
    """Return panels of contraction, sensitivities, and relative width of the posterior."""
    table = results.summary
    if table is None:
        return []
    names = [n for kind in COLOURS for n in results.names(kind) if n in table.index]
    table = table.loc[names]
    kinds = [results.kind(name) for name in names]
    colours = np.array([COLOURS[kind] for kind in kinds])
    height = 0.135 * len(table) + 0.75
    figure, ((left, middle, right),) = panels.grid(1, 3, height, sharey=True)
    _contraction(left, table, colours)
    _sensitivity(middle, table, colours)
    _width(right, table, colours)
    labels = [symbol_text(name, results.label(name)["symbol"]) for name in names]
    panels.name_rows(left, labels, fontsize=6.0)
    handles = [Patch(color=colour, label=k) for k, colour in COLOURS.items() if k in kinds]
    set_by_prior = Patch(facecolor="white", edgecolor=style.VERMILLION, label=SET_BY_PRIOR)
    figure.legend(handles=[*handles, set_by_prior], loc="outside lower center", ncols=5)
    return [figure]


def _contraction(ax: Axes, table: pd.DataFrame, colours: NDArray[np.str_]) -> None:
    limit = 100 * SMALLEST_CONTRACTION
    for row, (value, colour) in enumerate(zip(table["contraction"], colours, strict=True)):
        if not np.isfinite(value):
            continue
        ax.barh(row, 100 * np.clip(value, 0, 1), color=colour, height=0.65)
        if in_words(table.iloc[row]) == SET_BY_PRIOR:
            ax.barh(row, limit, facecolor="none", edgecolor=style.VERMILLION, height=0.65,
                    linewidth=0.8)  # fmt: skip
    panels.mark_limit(ax, limit)
    ax.set_xlim(0, 102)
    ax.set_xlabel("contraction (%)")


def _sensitivity(ax: Axes, table: pd.DataFrame, colours: NDArray[np.str_]) -> None:
    rows = np.arange(len(table))
    if "prior_sensitivity" in table:
        ax.scatter(table["prior_sensitivity"], rows, s=10, marker="D", c=colours, zorder=3)
        ax.scatter(table["likelihood_sensitivity"], rows, s=24, facecolors="none",
                   edgecolors=colours, linewidths=0.8, zorder=3)  # fmt: skip
    panels.mark_limit(ax, SENSITIVE)
    ax.set_xlim(left=0)
    ax.set_xlabel("moved by prior (◆), by data (○)")
    panels.rule(ax)


def _width(ax: Axes, table: pd.DataFrame, colours: NDArray[np.str_]) -> None:
    relative = 100 * (table["q95"] - table["q05"]) / 2 / table["median"].abs()
    shown = np.isfinite(relative) & (relative > 0)
    ax.scatter(relative[shown], np.flatnonzero(shown), c=colours[shown], s=10, zorder=3)
    ax.set_xscale("log")
    ax.set_xlabel("half width of 90 % interval\n(% of the median)")
    panels.rule(ax)
