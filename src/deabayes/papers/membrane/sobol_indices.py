"""Which parameters decide the response at which stage: Sobol' indices with intervals."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, CandidateResults
from deabayes.quantities import symbol_text

SCOPE = "candidate"
ANALYSIS = "influence"
TITLE = "Which parameters decide the response, by stage"
CAPTION = (
    "Sobol' indices. After a step: of the response's change at times since, and of the creep "
    "between them. Under a sine: of the peak-to-peak response in the first and the last whole "
    "cycle, of the creep of the cycle's mean between the two, and of the loop's area. Over the "
    "whole prior, where at least 1 % of draws fail: of whether a draw fails. First order: the "
    "share of the variance that a parameter explains alone; total: its share with all "
    "interactions. Bars end in 95 % intervals, an arrow where one goes on beyond the axis. The "
    "indices hold for the central region of the prior named above, in which hardly any model run "
    "fails. Of a prior handed on by another study the normal with its mean and covariance is taken."
)
COLUMNS = 4
END = 1.05
FIRST, TOTAL = style.BLUE, "#b9d4ea"


def draw(results: CandidateResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one sheet per record, with one panel per stage."""
    if "sobol" not in analysis.tables:
        return []
    table = analysis.tables["sobol"]
    table = table[table["candidate"] == results.name]
    return [_sheet(rows) for _, rows in table.groupby("record", sort=False)]


def _sheet(rows: pd.DataFrame) -> Figure:
    stages = list(rows.groupby("stage", sort=False))
    symbols = dict(zip(rows["parameter"], rows["symbol"], strict=True))
    labels = [symbol_text(name, symbol) for name, symbol in symbols.items()]
    lines = -(-len(stages) // COLUMNS)
    height = lines * (0.35 + 0.15 * len(symbols)) + 0.75
    figure, axes = panels.cells(len(stages), COLUMNS, height, sharex=True)
    for k, (ax, (stage, of_stage)) in enumerate(zip(axes, stages, strict=True)):
        _bars(ax, of_stage)
        ax.set_title(stage.replace("lost", "draw fails (whole prior)"), loc="left")
        ax.set_yticks(range(len(symbols)), labels if k % COLUMNS == 0 else [])
        ax.tick_params(axis="x", labelbottom=k + COLUMNS >= len(stages))
        ax.set_xlabel("share of the variance" if k >= (lines - 1) * COLUMNS else "")
    region = rows.loc[rows["stage"] != "lost", "region_percent"].iloc[0]
    text = f"{rows['record'].iloc[0]}, central {region:.0f} % of the prior in each coordinate"
    figure.suptitle(text)
    handles = [Patch(color=FIRST, label="first order"), Patch(color=TOTAL, label="total")]
    panels.legend_below(figure, handles)
    return figure


def _bars(ax: Axes, rows: pd.DataFrame) -> None:
    """Draw a wide light bar for the total index and a narrow dark one for the first order."""
    place = range(len(rows))
    for name, colour, height, shift in (
        ("total", TOTAL, 0.8, 0.2),
        ("first_order", FIRST, 0.4, -0.2),
    ):
        ax.barh(place, rows[name].clip(lower=0.0), height, color=colour)
        ax.errorbar(
            rows[name], [k + shift for k in place], xerr=rows[f"{name}_conf"],
            fmt="none", ecolor=style.BLACK, elinewidth=0.6, capsize=1.2, capthick=0.5,
        )  # fmt: skip
        beyond = np.flatnonzero(rows[name] + rows[f"{name}_conf"] > END)
        ax.plot(np.full(beyond.size, END), beyond + shift, ">", color=style.BLACK, markersize=2.5,
                clip_on=False, in_layout=False)  # fmt: skip
    ax.set_xlim(0.0, END)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
