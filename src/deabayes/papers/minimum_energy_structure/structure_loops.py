"""Displacement against voltage at several frequencies: the paper's Fig. 4(C, D)."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.hysteresis import draw_cycles
from deabayes.papers.timing import near
from deabayes.quantities import short

SCOPE = "study"
ANALYSIS = "hysteresis"
SYSTEMS = ("minimum_energy_structure",)
TITLE = "Loops: transition and rate"
CAPTION = (
    "Left: every measured cycle of the slowest sine, from the first (light) to the last (dark): "
    "the transition creeps into the stable region. Right: the last cycle at 1, 5 and 10 Hz, "
    "measured (points) and as the recommended candidate predicts it (line; band: interval of the "
    "draws). The loops are asymmetric and widen with the rate."
)


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one row per voltage."""
    shown = [
        record
        for record in panels.by_size(analysis.curves.values(), "frequency_Hz")[::-1]
        if any(near(float(record.attrs["frequency_Hz"]), hertz) for hertz in paper.SHOWN)
    ]
    if not shown:
        return []
    voltages = sorted({_volts(record) for record in shown}, reverse=True)
    rates = list(dict.fromkeys(_rate(record) for record in shown))
    candidate = panels.place_of(results.recommended.name, shown[0])
    height = 2.3 * len(voltages) + 0.6
    figure, axes = panels.grid(len(voltages), 2, height, sharex="row", sharey="row")
    for (left, right), volts in zip(axes, voltages, strict=True):
        own = [record for record in shown if _volts(record) == volts]
        _transition(left, own[0])
        _rates(right, own, candidate, rates)
        left.set_ylabel("displacement (mm)")
        name = panels.names(own[0])[candidate]
        right.set_title(f"{short(volts)} kV, last cycle, {name}", loc="left")
    for ax in axes[-1]:
        ax.set_xlabel("voltage (kV)")
    entries = [
        panels.key(f"{rate} Hz", panels.colour(k), linestyle=panels.line(k),
                   marker=panels.marker(k), markersize=2.5)
        for k, rate in enumerate(rates)
    ]  # fmt: skip
    band = Patch(color=style.GREY, alpha=0.25, label=panels.BAND)
    panels.legend_below(figure, [*entries, band], 4)
    return [figure]


def _transition(ax: Axes, record: xr.Dataset) -> None:
    draw_cycles(ax, record)
    first, last = record["cycle"].values[[0, -1]]
    words = f"{short(_volts(record))} kV, {_rate(record)} Hz, cycles {first} to {last}"
    ax.set_title(words, loc="left")


def _rates(ax: Axes, records: list[xr.Dataset], candidate: int, rates: list[str]) -> None:
    for record in records:
        k = rates.index(_rate(record))
        volts = record["voltage"].values[-1] / 1e3
        panels.draw_loop(ax, volts, 1e3 * record["predicted"].values[candidate][:, -1], k)
        ax.plot(volts[::4], 1e3 * record["measured"].values[-1][::4], linestyle="none",
                marker=panels.marker(k), markersize=2.2, color=panels.colour(k),
                markeredgecolor=style.BLACK, markeredgewidth=0.3)  # fmt: skip


def _rate(record: xr.Dataset) -> str:
    return short(float(record.attrs["frequency_Hz"]), 2)


def _volts(record: xr.Dataset) -> float:
    return round(float(record.attrs["amplitude_kV"]), 1)
