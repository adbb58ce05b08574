"""Each parameter moved alone over its prior (Nguyen et al. 2021, Figs. 8 and 10)."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from deabayes.figures import panels, style
from deabayes.figures.prior_axes import drive, head, horizontal, vertical
from deabayes.figures.quantities import display_unit, short, symbol_text
from deabayes.figures.results import CandidateResults

SCOPE = "candidate"
ANALYSIS = "influence"
TITLE = "One parameter at a time"
CAPTION = (
    "The response as one parameter moves over quantiles of its prior while the others stay at "
    "their prior medians. Values that leave no response (pull-in, beyond the breakdown stretch) "
    "are named in the panel. What parameters do together is in the Sobol' indices."
)
COLOURS = (style.BLUE, style.SKY, style.BLACK, style.ORANGE, style.VERMILLION)


def draw(results: CandidateResults) -> list[Figure]:
    """One sheet per record, one panel per parameter."""
    found = results.study.analysis(ANALYSIS)
    if found is None:
        return []
    start = f"one_at_a_time_{results.name}_"
    return [_sheet(c) for name, c in found.curves.items() if name.startswith(start)]


def _sheet(curves: xr.Dataset) -> Figure:
    count = curves.sizes["parameter"]
    figure, axes = panels.sheet(count, 36 * style.MILLIMETRE)
    head(figure, drive(curves))
    columns = axes[0].get_gridspec().ncols
    bottom = (count - 1) // columns * columns
    shown, x = horizontal(curves)
    values = curves["curve"].values[..., shown]
    unit, label = vertical(curves, values)
    low, high = np.nanmin(values) / unit.factor, np.nanmax(values) / unit.factor
    margin = 0.04 * (high - low)
    for k, ax in enumerate(axes):
        for row, colour in zip(values[k], COLOURS, strict=True):
            ax.plot(x.values, row / unit.factor, color=colour, linewidth=0.9)
        ax.set_ylim(low - margin, high + margin)
        panels.set_horizontal(ax, x)
        if k < bottom:
            ax.set_xlabel("")
            ax.tick_params(labelbottom=k + columns >= count)
        if k % columns:
            ax.tick_params(labelleft=False)
        _words(ax, curves.isel(parameter=k), np.isnan(values[k, :, 0]))
    for ax in axes[::columns]:
        ax.set_ylabel(label)
    handles = [
        Line2D([], [], color=colour, label=f"{100 * q:.0f} %")
        for q, colour in zip(curves["quantile"].values, COLOURS, strict=True)
    ]
    panels.legend_below(figure, handles, columns=len(handles))
    return figure


def _words(ax: Axes, parameter: xr.Dataset, lost: NDArray[np.bool_]) -> None:
    """The parameter and its range above the panel, the values without a response in it."""
    name, values = str(parameter["parameter"].values), parameter["value"].values
    unit = display_unit(str(parameter["unit"].values), values, name)
    shown = values / unit.factor
    text = f"{short(shown[0], 2)} to {short(shown[-1], 2)} {unit.label}".rstrip()
    ax.set_title(
        f"{symbol_text(name, str(parameter['symbol'].values))}: {text}", loc="left", fontsize=7
    )
    if lost.any():
        which = ", ".join(short(value, 2) for value in shown[lost])
        ax.text(
            0.03, 0.95, f"no response at {which} {unit.label}".rstrip(), transform=ax.transAxes,
            va="top", fontsize=6.0, color=style.GREY,
        )  # fmt: skip
