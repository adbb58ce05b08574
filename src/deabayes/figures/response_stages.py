"""Step responses with their stages, and what each stage adds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES

SCOPE = "study"
ANALYSIS = "response_stages"
TITLE = "Stages of the step response"
CAPTION = (
    "Above: displacement after the step, measured and predicted, on a logarithmic time axis; "
    "dotted lines part the stages. Below: the share of the last displacement that each stage adds, "
    "measured (bars) and predicted."
)
SHOWN = 3
NUMBERS = ("I", "II", "III")


def draw(results: StudyResults) -> list[Figure]:
    """One column per step record, highest voltage first; three to a sheet."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "voltage_kV")
    return [_sheet(list(group), found.tables["stages"]) for group in panels.batches(records, SHOWN)]


def _sheet(records: list[xr.Dataset], stages: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 3.9 + style.HEADER), layout="constrained")
    axes = figure.subplots(2, len(records), squeeze=False, height_ratios=(3, 2))
    for column, record in enumerate(records):
        role = str(record.attrs["role"])
        axes[0, column].set_title(
            f"{record.attrs['experiment']}, {ROLES.get(role, role)}", loc="left"
        )
        _response(axes[0, column], record)
        own = stages[stages["experiment"] == record.attrs["experiment"]]
        _shares(axes[1, column], own, record)
    axes[0, 0].set_ylabel("displacement (mm)")
    axes[1, 0].set_ylabel("share added (%)")
    panels.legend_below(figure, panels.handles(records[0]), 5)
    return figure


def _response(ax: Axes, record: xr.Dataset) -> None:
    time = record["time"].values
    shown = time > 0.0
    for k in range(record["candidate"].size):
        bands = 1e3 * record["predicted"].values[k][:, shown]
        panels.draw_candidate(ax, time[shown], bands, k)
    panels.draw_observed(ax, time[shown], 1e3 * record["measured"].values[shown], 1.6)
    ends = record["stage_end"].values
    edges = [time[shown][0], *np.minimum(ends, time[-1])]
    for number, (start, end) in zip(NUMBERS, pairwise(edges), strict=True):
        if end < time[-1]:
            ax.axvline(end, color=style.GREY, linestyle=":", linewidth=0.8)
        ax.text(np.sqrt(start * end), 0.03, number, transform=ax.get_xaxis_transform(),
                ha="center", color=style.GREY)  # fmt: skip
    panels.logarithmic(ax, time[shown])
    ax.set_xlabel("time since the step (s)")
    ax.set_ylim(bottom=0.0)


def _shares(ax: Axes, stages: pd.DataFrame, record: xr.Dataset) -> None:
    order = [str(stage) for stage in record["stage"].values]
    candidates = [str(name) for name in record["candidate"].values]
    for k, name in enumerate(candidates):
        rows = stages[stages["candidate"] == name].set_index("stage").loc[order]
        x = np.arange(len(order)) + panels.spread(k, len(candidates), 0.18)
        middle = rows["predicted_percent"].to_numpy()
        reach = np.abs([middle - rows["predicted_q05"], rows["predicted_q95"] - middle])
        ax.errorbar(x, middle, yerr=reach, fmt=panels.marker(k), color=panels.colour(k),
                    markersize=2.5, elinewidth=0.8)  # fmt: skip
    measured = stages[stages["candidate"] == candidates[0]].set_index("stage").loc[order]
    ax.bar(np.arange(len(order)), measured["measured_percent"], width=0.7, zorder=0,
           facecolor="#e4e4e4", edgecolor=style.BLACK, linewidth=0.6)  # fmt: skip
    labels = [f"{number}: {stage}" for number, stage in zip(NUMBERS, order, strict=True)]
    ax.set_xticks(np.arange(len(order)), labels)
    ax.set_xlim(-0.5, len(order) - 0.5)
    ax.set_ylim(bottom=0.0)
