"""Hysteresis loops as each parameter alone moves over its prior (Nguyen et al. 2021, Fig. 10)."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, CandidateResults
from deabayes.papers.membrane import prior_axes
from deabayes.quantities import display_unit, plain

SCOPE = "candidate"
ANALYSIS = "influence"
TITLE = "Hysteresis loops, one parameter at a time"
CAPTION = (
    "The last whole cycle of a sine as one parameter moves over quantiles of its prior while the "
    "others stay at their prior medians. Right of the loops: how far the mean of the response "
    "creeps from the first whole cycle (foot) to the last (dot). Values that leave no response "
    "(pull-in, beyond the breakdown stretch) are named in the panel."
)
FIRST, LAST = 0, -1
GAP, SPACING = 0.16, 0.09
"""Distances from loops to the first creep bar, and between bars, over the peak excitation."""
ROUNDING = 0.01
"""Tolerance of the peak, because noise and even phases slightly shift a peak of 2 kV."""


def draw(results: CandidateResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one sheet per record, with one panel per parameter."""
    start = f"loops_{results.name}_"
    return [_sheet(c) for name, c in analysis.curves.items() if name.startswith(start)]


def _sheet(curves: xr.Dataset) -> Figure:
    figure, axes = panels.sheet(curves.sizes["parameter"], 38 * style.MILLIMETRE)
    first, last = curves["cycle"].values[[FIRST, LAST]]
    figure.suptitle(f"{prior_axes.drive(curves)}, cycle {last}")
    values = curves["curve"].values[:, :, LAST]
    unit, label = prior_axes.vertical(curves, values)
    for k, ax in enumerate(axes):
        parameter = curves.isel(parameter=k)
        _panel(ax, parameter, unit.factor)
        prior_axes.words(ax, parameter, np.isnan(values[k, :, 0]))
    shown = np.concatenate([values.ravel(), curves["mean"].values.ravel()])
    prior_axes.share(axes, label, shown / unit.factor)
    creep = panels.key(f"mean of the cycle, {first} to {last} (dot)", style.GREY, marker="o",
                       markersize=2.2, linestyle="-", linewidth=0.9)  # fmt: skip
    columns = curves.sizes["quantile"] + 1
    panels.legend_below(figure, [*prior_axes.handles(curves), creep], columns)
    return figure


def _panel(ax: Axes, parameter: xr.Dataset, factor: float) -> None:
    volts = parameter["excitation"].values[LAST]
    name = str(parameter.attrs["excitation_name"])
    unit = display_unit(str(parameter.attrs["excitation_unit"]), volts, name)
    loops, means = parameter["curve"].values[:, LAST] / factor, parameter["mean"].values / factor
    shades = prior_axes.colours(parameter)
    for response, colour in zip(loops, shades, strict=True):
        ax.plot(volts / unit.factor, response, color=colour, linewidth=0.9)
    peak = float(np.abs(volts).max()) / unit.factor
    _creep(ax, peak, means[:, [FIRST, LAST]], shades)
    ticks = MaxNLocator(5).tick_values(-peak, peak)
    ax.set_xticks(ticks[np.abs(ticks) <= peak * (1.0 + ROUNDING)])
    ax.spines["bottom"].set_bounds(-peak, peak)
    ax.set_xlabel(plain(name) + unit.suffix)


def _creep(ax: Axes, peak: float, means: FloatArray, shades: FloatArray) -> None:
    """Draw one bar per quantile from the first to the last mean, to the right of the loops."""
    for k, (ends, colour) in enumerate(zip(means, shades, strict=True)):
        place = peak * (1.0 + GAP + k * SPACING)
        ax.plot([place, place], ends, color=colour, linewidth=0.9)
        ax.plot(place, ends[-1], "o", color=colour, markersize=2.2)
