"""e_rms of the sines against frequency: the paper's Table 5 as a figure."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES

SCOPE = "study"
ANALYSIS = "structure_errors"
TITLE = "Errors of the sines"
CAPTION = (
    "e_rms of each sine as prepared, in per cent of its range: of the posterior median curve, with "
    "the interval of the draws' own errors; filled points were fitted, open ones held out. "
    "Crosses: the paper's Table 5, found on its own specimen. The axis is logarithmic where errors "
    "differ by more than a factor of 20."
)

POINTS = r"e_rms_.*_percent$"
ERRORS = r"e_rms_.*_(percent|q05|q95)$"


def draw(results: StudyResults) -> list[Figure]:
    """One panel per voltage."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.tables:
        return []
    table = found.tables["table_5_errors"]
    voltages = [c.removeprefix("role_") for c in table.columns if str(c).startswith("role_")]
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 2.5 + style.HEADER), layout="constrained")
    axes = figure.subplots(1, len(voltages), sharey=True, squeeze=False)[0]
    for ax, voltage in zip(axes, voltages, strict=True):
        _panel(ax, table, voltage)
    errors = table.filter(regex=ERRORS).to_numpy(dtype=float)
    if panels.spans_much(table.filter(regex=POINTS).to_numpy(dtype=float)):
        panels.logarithmic(axes[0], errors, which="y")
    else:
        axes[0].set_ylim(bottom=0.0)
    axes[0].set_ylabel("$e_\\mathrm{rms}$ (% of range)")
    panels.legend_below(figure, _handles(table), 4)
    return [figure]


def _panel(ax: Axes, table: pd.DataFrame, voltage: str) -> None:
    names = list(dict.fromkeys(table["candidate"]))
    for k, name in enumerate(names):
        own = table[table["candidate"] == name]
        place = own["frequency_Hz"].to_numpy() + 0.8 * panels.spread(k, len(names))
        value = own[f"e_rms_{voltage}_percent"].to_numpy()
        ends = own[f"e_rms_{voltage}_q05"].to_numpy(), own[f"e_rms_{voltage}_q95"].to_numpy()
        ax.vlines(place, *ends, color=panels.colour(k), linewidth=0.9)
        fitted = (own[f"role_{voltage}"] == "calibrate").to_numpy()
        for part, fill in ((fitted, panels.colour(k)), (~fitted, "white")):
            ax.plot(place[part], value[part], linestyle="none", marker=panels.marker(k),
                    color=panels.colour(k), markerfacecolor=fill, markersize=3.5,
                    clip_on=False, in_layout=False)  # fmt: skip
    printed = table.drop_duplicates("frequency_Hz")
    ax.plot(printed["frequency_Hz"], printed[f"paper_e_rms_{voltage}_percent"], "x",
            color=style.BLACK, markersize=4, clip_on=False, in_layout=False)  # fmt: skip
    ax.set_xlabel("frequency (Hz)")
    ax.set_xticks(sorted(np.unique(table["frequency_Hz"].round().astype(int))))
    ax.set_title(voltage.replace("kV", " kV"), loc="left")


def _handles(table: pd.DataFrame) -> list[Line2D]:
    pairs = table.drop_duplicates("candidate")[["candidate", "converged"]].to_numpy()
    entries = [
        Line2D([], [], color=panels.colour(k), marker=panels.marker(k), linestyle="none",
               label=f"{name}" + ("" if converged else " (not converged)"))
        for k, (name, converged) in enumerate(pairs)
    ]  # fmt: skip
    roles = [
        Line2D([], [], color=style.GREY, marker="o", linestyle="none", markerfacecolor=fill,
               label=ROLES[role])
        for role, fill in (("calibrate", style.GREY), ("validate", "white"))
    ]  # fmt: skip
    paper = Line2D([], [], color=style.BLACK, marker="x", linestyle="none", label="paper, Table 5")
    return [*entries, *roles, paper]
