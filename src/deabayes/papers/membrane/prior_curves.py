"""Curves drawn from the prior of every candidate (Nguyen et al. 2021, Fig. 7)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers.membrane.prior_axes import drive, horizontal, vertical
from deabayes.quantities import short

SCOPE = "study"
ANALYSIS = "influence"
TITLE = "Curves drawn from the prior"
CAPTION = (
    "Twenty random draws from each candidate's prior and the central 50 and 90 % of a thousand, "
    "for the strongest record of each protocol. Draws that fail (pull-in, beyond the breakdown "
    "stretch) have no curve; how many is said above each panel. The bands are of the others. A "
    "panel ends where the widest band does."
)
WIDE, NARROW = "#dbe9f4", "#a9cce6"


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one sheet per record, with one panel per candidate."""
    by_record: dict[str, list[xr.Dataset]] = {}
    for name, curves in analysis.curves.items():
        if name.startswith("prior_"):
            by_record.setdefault(str(curves.attrs["experiment"]), []).append(curves)
    return [_sheet(candidates) for candidates in by_record.values()]


def _sheet(candidates: Sequence[xr.Dataset]) -> Figure:
    figure, axes = panels.sheet(len(candidates), 52 * style.MILLIMETRE)
    figure.suptitle(drive(candidates[0]))
    bands = np.concatenate([c["band"].values.ravel() for c in candidates])
    bands = bands[np.isfinite(bands)]
    low, top = (float(bands.min()), float(bands.max())) if bands.size else (0.0, 1.0)
    unit, label = vertical(candidates[0], np.array([low, top]))
    for ax, curves in zip(axes, candidates, strict=True):
        _panel(ax, curves, unit.factor)
        ax.set_ylim((low - 0.03 * (top - low)) / unit.factor, top / unit.factor)
    axes[0].set_ylabel(label)
    entries = [
        panels.key("20 random draws", style.BLUE, linewidth=0.7),
        Patch(color=NARROW, label="central 50 % of draws"),
        Patch(color=WIDE, label="central 90 %"),
        panels.key("observed", marker="."),
    ]
    panels.legend_below(figure, entries, columns=4)
    return figure


def _panel(ax: Axes, curves: xr.Dataset, factor: float) -> None:
    shown, x = horizontal(curves)
    band = curves["band"].values[:, shown] / factor
    ax.fill_between(x.values, band[0], band[-1], color=WIDE, linewidth=0)
    ax.fill_between(x.values, band[1], band[-2], color=NARROW, linewidth=0)
    drawn = curves["curve"].values[:, shown] / factor
    ax.plot(x.values, drawn.T, color=style.BLUE, linewidth=0.6, alpha=0.8)
    time = curves["time"].values - curves.attrs["onset"]
    inside = (time >= x.values[0]) & (time <= x.values[-1])
    panels.draw_observed(ax, time[inside], curves["observed"].values[inside] / factor, size=1.6)
    panels.set_horizontal(ax, x)
    ax.set_xlim(x.values[0], x.values[-1])
    failed = curves["failed"].values
    few = int(failed[: len(drawn)].sum())
    share = short(100 * failed.mean(), 2)
    words = f"fail: {few} of the {len(drawn)} shown, {share} % of {failed.size}"
    panels.heading(ax, str(curves.attrs["candidate"]), words)
