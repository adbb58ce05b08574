"""Displacement against voltage at several frequencies: the paper's Fig. 4(C, D)."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import short

SCOPE = "study"
ANALYSIS = "hysteresis"
SYSTEMS = ("minimum_energy_structure",)
TITLE = "Loops: transition and rate"
SHOWN = (1.0, 5.0, 10.0)
NEAR = 0.02
CAPTION = (
    "Left: every measured cycle of the slowest sine, from the first (light) to the last (dark): "
    "the transition creeps into the stable region. Right: the last cycle at 1, 5 and 10 Hz, "
    "measured (points) and as the recommended candidate predicts it (line; band: interval of the "
    "draws). The loops are asymmetric and widen with the rate."
)


def draw(results: StudyResults) -> list[Figure]:
    """Return one row per voltage."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "frequency_Hz")[::-1]
    shown = [r for r in records if _matches(float(r.attrs["frequency_Hz"]))]
    voltages = sorted({_volts(r) for r in shown}, reverse=True)
    if not shown:
        return []
    height = 2.3 * len(voltages) + 0.6 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    axes = figure.subplots(len(voltages), 2, squeeze=False, sharex="row", sharey="row")
    names, best = [str(n) for n in shown[0]["candidate"].values], results.recommended.name
    candidate = names.index(best) if best in names else 0
    rates = list(dict.fromkeys(_rate(record) for record in shown))
    for (left, right), volts in zip(axes, voltages, strict=True):
        own = [r for r in shown if _volts(r) == volts]
        _transition(left, own[0])
        _rates(right, own, candidate, rates)
        left.set_ylabel("displacement (mm)")
        right.set_title(f"{short(volts)} kV, last cycle, {panels.names(own[0])[candidate]}",
                        loc="left")  # fmt: skip
    for ax in axes[-1]:
        ax.set_xlabel("voltage (kV)")
    panels.legend_below(figure, _handles(rates), 4)
    return [figure]


def _transition(ax: Axes, record: xr.Dataset) -> None:
    measured, volts = 1e3 * record["measured"].values, record["voltage"].values / 1e3
    shades = colormaps["Greys"](np.linspace(0.3, 1.0, len(measured)))
    for k, shade in enumerate(shades):
        ax.plot(volts[k], measured[k], color=shade, linewidth=0.8)
    first, last = record["cycle"].values[[0, -1]]
    ax.set_title(
        f"{short(_volts(record))} kV, {_rate(record)} Hz, cycles {first} to {last}", loc="left"
    )


def _rates(ax: Axes, records: list[xr.Dataset], candidate: int, rates: list[str]) -> None:
    for record in records:
        k = rates.index(_rate(record))
        volts = record["voltage"].values[-1] / 1e3
        lower, median, upper = 1e3 * record["predicted"].values[candidate][:, -1]
        panels.fill_loop(ax, volts, lower, upper, k)
        ax.plot(volts, median, color=panels.colour(k), linestyle=panels.line(k))
        ax.plot(volts[::4], 1e3 * record["measured"].values[-1][::4], linestyle="none",
                marker=panels.marker(k), markersize=2.2, color=panels.colour(k),
                markeredgecolor=style.BLACK, markeredgewidth=0.3)  # fmt: skip


def _rate(record: xr.Dataset) -> str:
    return short(float(record.attrs["frequency_Hz"]), 2)


def _handles(rates: list[str]) -> list[Line2D | Patch]:
    entries: list[Line2D | Patch] = [
        Line2D([], [], color=panels.colour(k), linestyle=panels.line(k), marker=panels.marker(k),
               markersize=2.5, label=f"{rate} Hz")
        for k, rate in enumerate(rates)
    ]  # fmt: skip
    return [*entries, Patch(color=style.GREY, alpha=0.25, label=panels.BAND)]


def _matches(hertz: float) -> bool:
    return any(abs(hertz - shown) <= NEAR * shown for shown in SHOWN)


def _volts(record: xr.Dataset) -> float:
    return round(float(record.attrs["amplitude_kV"]), 1)
