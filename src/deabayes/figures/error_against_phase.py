"""The stable cycle of sines and its error against the phase: the paper's Figs 8 and 10."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES, short

SCOPE = "study"
ANALYSIS = "error_against_phase"
TITLE = "Error against phase"
CAPTION = (
    "Last whole cycle of each sine against the phase since the voltage was lowest: displacement "
    "above, measured minus predicted in per cent of the record's range below; medians and "
    "intervals of the draws."
)


def draw(results: StudyResults) -> list[Figure]:
    """One sheet per voltage, one column per frequency."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "frequency_Hz")[::-1]
    voltages = sorted({round(float(r.attrs["amplitude_kV"]), 1) for r in records}, reverse=True)
    return [
        _sheet([r for r in records if round(float(r.attrs["amplitude_kV"]), 1) == voltage])
        for voltage in voltages
    ]


def _sheet(records: list[xr.Dataset]) -> Figure:
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 3.9 + style.HEADER), layout="constrained")
    axes = figure.subplots(2, len(records), squeeze=False, sharex=True, sharey="row")
    for (above, below), record in zip(axes.T, records, strict=True):
        _moved(above, record)
        _error(below, record)
        below.set_xlabel("phase of the voltage (°)")
        below.set_xticks(range(0, 361, 90))
    axes[0, 0].set_ylabel("displacement (mm)")
    axes[1, 0].set_ylabel("error (% of range)")
    panels.legend_below(figure, panels.handles(records[0]), 4)
    return figure


def _moved(ax: Axes, record: xr.Dataset) -> None:
    phase = 360.0 * record["phase"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, phase, 1e3 * record["predicted"].values[k], k)
    ax.plot(phase, 1e3 * record["measured"].values, "o", color=style.BLACK, markersize=2.5)
    hertz, volts = (short(float(record.attrs[n]), 2) for n in ("frequency_Hz", "amplitude_kV"))
    ax.set_title(f"{volts} kV, {hertz} Hz, {ROLES[str(record.attrs['role'])]}", loc="left")


def _error(ax: Axes, record: xr.Dataset) -> None:
    phase = 360.0 * record["phase"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, phase, record["error"].values[k], k)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    ax.set_xlim(0.0, 360.0)
