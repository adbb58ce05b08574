"""Displacement against voltage, and how the loop changes from cycle to cycle."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import short

SCOPE = "study"
ANALYSIS = "hysteresis"
TITLE = "Hysteresis loops"
CAPTION = (
    "Left: measured loops from the first cycle (light) to the last (dark), and the last cycle as "
    "the recommended candidate predicts it. Middle: loop area −∮ u d|Φ| of each cycle. Right: mean "
    "displacement of each cycle, whose rise is creep."
)
SHOWN = 4


def draw(results: StudyResults) -> list[Figure]:
    """One row per sine, highest voltage and slowest first."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    loops = panels.by_size(list(found.curves.values()), "frequency_Hz")[::-1]
    loops = sorted(loops, key=lambda each: -round(float(each.attrs["amplitude_kV"]), 1))
    best, table = results.recommended.name, found.tables["hysteresis_cycles"]
    return [_sheet(list(group), table, best) for group in panels.batches(loops, SHOWN)]


def _sheet(loops: list[xr.Dataset], table: pd.DataFrame, best: str) -> Figure:
    height = 1.65 * len(loops) + 0.6 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    axes = figure.subplots(len(loops), 3, squeeze=False, width_ratios=(5, 4, 4))
    names = [str(name) for name in loops[0]["candidate"].values]
    shown = best if best in names else names[0]
    for row, record in zip(axes, loops, strict=True):
        rows = table[table["experiment"] == record.attrs["experiment"]]
        _loops(row[0], record, names.index(shown))
        volts, hertz = (short(record.attrs[n], 2) for n in ("amplitude_kV", "frequency_Hz"))
        row[0].set_title(f"{volts} kV, {hertz} Hz", loc="left")
        for ax, (name, unit, label) in zip(
            row[1:], (("area", "kVmm", "loop area (kV·mm)"), ("mean", "mm", "mean (mm)")),
            strict=True,
        ):  # fmt: skip
            _per_cycle(ax, rows, names, name, unit)
            ax.set_ylabel(label)
    for ax, label in zip(axes[-1], ("voltage (kV)", "cycle", "cycle"), strict=True):
        ax.set_xlabel(label)
    entries = [
        Line2D([], [], color=style.BLACK, label="measured loops, last dark"),
        *panels.handles(loops[0]),
    ]
    panels.legend_below(figure, entries, 3)
    return figure


def _loops(ax: Axes, record: xr.Dataset, candidate: int) -> None:
    volts, measured = record["voltage"].values / 1e3, 1e3 * record["measured"].values
    count = len(measured)
    shades = colormaps["Greys"](np.linspace(0.3, 1.0, count))
    for k in range(count):
        ax.plot(volts[k], measured[k], color=shades[k], linewidth=0.8)
    lower, median, upper = 1e3 * record["predicted"].values[candidate][:, -1]
    panels.fill_loop(ax, volts[-1], lower, upper, candidate)
    ax.plot(volts[-1], median, color=panels.colour(candidate), linestyle=panels.line(candidate))
    ax.set_ylabel("displacement (mm)")


def _per_cycle(ax: Axes, rows: pd.DataFrame, names: list[str], name: str, unit: str) -> None:
    column = f"predicted_{name}"
    for k, candidate in enumerate(names):
        own = rows[rows["candidate"] == candidate]
        keys = (f"{column}_q05", f"{column}_{unit}", f"{column}_q95")
        bands = np.array([own[key].to_numpy() for key in keys])
        panels.draw_candidate(ax, own["cycle"].to_numpy(), bands, k)
    own = rows[rows["candidate"] == names[0]]
    ax.plot(own["cycle"], own[f"measured_{name}_{unit}"], "o", color=style.BLACK, markersize=2.5)
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=True))
