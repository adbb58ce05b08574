"""Amplitude against frequency: the paper's Fig. 9, and on along a sweep."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES, short

SCOPE = "study"
ANALYSIS = "structure_amplitude"
TITLE = "Amplitude against frequency of the structure"
BANDS, WIDTH = "bands_", 0.02
MEASURED = "#8c8c8c"
CAPTION = (
    "Peak-to-peak displacement in the settled cycle against the voltage's frequency: measured "
    "sines (filled: fitted) and predicted curves (median, interval of the draws); grey: the "
    "frequencies beyond the sines, an extrapolation. Where a sweep was recorded, its measured "
    "amplitude (dots) and what each candidate predicts for it in the panel beside: a sweep is "
    "read from a few cycles at a time, and starts before the creep has settled."
)


def draw(results: StudyResults) -> list[Figure]:
    """One panel per voltage of sines, one per sweep."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    sines = panels.by_size([c for n, c in found.curves.items() if n.startswith(BANDS)],
                           "amplitude_kV")  # fmt: skip
    sweeps = [c for n, c in found.curves.items() if not n.startswith(BANDS)]
    count = len(sines) + len(sweeps)
    figure, axes = panels.sheet(count, 2.3)
    for ax, record in zip(axes, sines, strict=False):
        _sines(ax, record)
    for ax, record in zip(axes[len(sines) :], sweeps, strict=True):
        _sweep(ax, record)
    panels.legend_below(figure, [*_roles(), *panels.handles(sines[0], measured=False)], 4)
    return [figure]


def _sines(ax: Axes, record: xr.Dataset) -> None:
    frequency, last = record["frequency"].values, float(record.attrs["last_sine_Hz"])
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, frequency, 1e3 * record["predicted"].values[k], k)
    fitted = record["calibrated"].values.astype(bool)
    at, seen = record["record_frequency"].values, 1e3 * record["measured"].values
    for part, fill in ((fitted, style.BLACK), (~fitted, "white")):
        ax.plot(at[part], seen[part], "o", color=style.BLACK, markerfacecolor=fill, markersize=3.5,
                zorder=5)  # fmt: skip
    if frequency[-1] > (1.0 + WIDTH) * last:
        ax.axvspan(last, frequency[-1], color="#ececec", zorder=0, linewidth=0)
    _axes(ax, frequency, f"sines of {short(float(record.attrs['amplitude_kV']), 2)} kV")


def _sweep(ax: Axes, record: xr.Dataset) -> None:
    frequency = record["frequency"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, frequency, 1e3 * record["predicted"].values[k], k)
    ax.plot(frequency, 1e3 * record["measured"].values, ".", color=MEASURED, markersize=4.0,
            markeredgewidth=0, zorder=1.5)  # fmt: skip
    title = f"sweep of {short(float(record.attrs['amplitude_kV']), 2)} kV"
    _axes(ax, frequency, f"{title}, {ROLES[str(record.attrs['role'])]}")


def _axes(ax: Axes, frequency: np.ndarray, title: str) -> None:
    panels.logarithmic(ax, frequency)
    ax.set_xlabel("frequency of the voltage (Hz)")
    ax.set_ylabel("peak to peak (mm)")
    ax.set_title(title, loc="left")
    ax.set_ylim(bottom=0.0)


def _roles() -> list[Line2D]:
    return [
        Line2D([], [], color=style.BLACK, marker="o", linestyle="none", markerfacecolor=fill,
               markersize=3.5, label=f"measured, {ROLES[role]}")
        for role, fill in (("calibrate", style.BLACK), ("validate", "white"))
    ] + [Line2D([], [], color=MEASURED, marker=".", linestyle="none", markersize=4.0,
                label="measured, sweep")]  # fmt: skip
