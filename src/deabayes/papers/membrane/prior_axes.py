"""Axes, colours and legend that the figures of the analysis `influence` share."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.record import Axis
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import DisplayUnit, display_unit, plain, short, symbol_text

CYCLES = 3
DARKEST, LIGHTEST = 0.0, 0.88
"""Range of the colour map in use; its yellow end is not visible on white."""
MARGIN = 0.04


def horizontal(curves: xr.Dataset) -> tuple[NDArray[np.bool_], Axis]:
    """Return which points to show, and their horizontal axis.

    The axis is logarithmic time since a step, or time over the excitation's first cycles.
    """
    time = curves["coordinate"].values - curves.attrs["onset"]
    if curves.attrs["held"]:
        shown = time > 0
        return shown, Axis(time[shown], "time since the step (s)", True)
    period = usual_period(passes(time, curves["excitation"].values))
    shown = time >= 0
    if np.isfinite(period):
        shown &= time <= CYCLES * period
    return shown, Axis(time[shown], "time since the start (s)")


def vertical(curves: xr.Dataset, values: FloatArray) -> tuple[DisplayUnit, str]:
    """Return the display unit of the response and the label of the axis."""
    name = str(curves.attrs["response_name"])
    unit = display_unit(str(curves.attrs["response_unit"]), values, name)
    return unit, plain(name) + unit.suffix


def drive(curves: xr.Dataset) -> str:
    """Name and peak excitation of a record, such as ``step_4kV, voltage to 4 kV``."""
    peak = float(np.abs(curves["excitation"].values).max())
    name = str(curves.attrs["excitation_name"])
    unit = display_unit(str(curves.attrs["excitation_unit"]), peak, name)
    amount = f"{short(peak / unit.factor, 2)} {unit.label}"
    return f"{curves.attrs['experiment']}, {plain(name)} to {amount}"


def colours(curves: xr.Dataset) -> FloatArray:
    """Colours (Q, 4), one per quantile, from dark to light.

    Their order stays visible in print and to colour-blind readers.
    """
    places = np.linspace(DARKEST, LIGHTEST, curves.sizes["quantile"])
    return np.asarray(colormaps["viridis"](places))


def handles(curves: xr.Dataset) -> list[Line2D]:
    """Legend entries of the quantiles."""
    pairs = zip(curves["quantile"].values, colours(curves), strict=True)
    return [panels.key(f"{100 * quantile:.0f} %", colour) for quantile, colour in pairs]


def words(ax: Axes, parameter: xr.Dataset, lost: NDArray[np.bool_]) -> None:
    """Write parameter and range above a panel, and values without a response in it."""
    name, values = str(parameter["parameter"].values), parameter["value"].values
    unit = display_unit(str(parameter["unit"].values), values, name)
    shown = values / unit.factor
    text = f"{short(shown[0], 2)} to {short(shown[-1], 2)}{unit.behind}"
    symbol = symbol_text(name, str(parameter["symbol"].values))
    ax.set_title(f"{symbol}: {text}", loc="left", fontsize=7)
    if lost.any():
        which = ", ".join(short(value, 2) for value in shown[lost])
        place = {"transform": ax.transAxes, "va": "top"}
        text = f"no response at {which}{unit.behind}"
        ax.text(0.03, 0.95, text, fontsize=6.0, color=style.GREY, **place)


def share(axes: list[Axes], label: str, values: FloatArray) -> None:
    """Give all panels the vertical axis of these values, and label only the outer panels.

    NaN of failed curves is ignored.
    """
    finite = values[np.isfinite(values)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    margin = MARGIN * (high - low) if finite.size else 0.0
    columns = axes[0].get_gridspec().ncols
    for k, ax in enumerate(axes):
        ax.set_ylim(low - margin, high + margin)
        if k + columns < len(axes):
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel(label)
