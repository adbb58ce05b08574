"""What figures of the analysis `influence` have in common: axes, colours, the legend."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import DisplayUnit, display_unit, plain, short, symbol_text

CYCLES = 3


def horizontal(curves: xr.Dataset) -> tuple[NDArray[np.bool_], panels.Axis]:
    """Which points to show, and where: log time since a step, or an excitation's first cycles."""
    time = curves["coordinate"].values - curves.attrs["onset"]
    if curves.attrs["held"]:
        shown = time > 0
        return shown, panels.Axis(time[shown], "time since the step (s)", True)
    period = usual_period(passes(time, curves["excitation"].values))
    shown = time >= 0
    if np.isfinite(period):
        shown &= time <= CYCLES * period
    return shown, panels.Axis(time[shown], "time since the start (s)")


def vertical(curves: xr.Dataset, values: FloatArray) -> tuple[DisplayUnit, str]:
    """The display unit of the response, and the axis' label."""
    name = str(curves.attrs["response_name"])
    unit = display_unit(str(curves.attrs["response_unit"]), values, name)
    return unit, plain(name) + unit.suffix


def head(figure: Figure, text: str) -> None:
    """Name the record in the strip above the axes, between the study and the marks."""
    figure.text(0.5, 1 - 0.05 / figure.get_size_inches()[1], text, ha="center", va="top")


def drive(curves: xr.Dataset) -> str:
    """``step_4kV, voltage to 4 kV``: the record and its peak excitation."""
    peak = float(np.abs(curves["excitation"].values).max())
    name = str(curves.attrs["excitation_name"])
    unit = display_unit(str(curves.attrs["excitation_unit"]), peak, name)
    amount = f"{short(peak / unit.factor, 2)} {unit.label}"
    return f"{curves.attrs['experiment']}, {plain(name)} to {amount}"


DARKEST, LIGHTEST = 0.0, 0.88
"""Of the colour map: its yellow end cannot be seen on white."""
MARGIN = 0.04


def colours(quantiles: int) -> FloatArray:
    """One per quantile (Q, 4), dark to light; their order survives colour blindness and print."""
    return np.asarray(colormaps["viridis"](np.linspace(DARKEST, LIGHTEST, quantiles)))


def handles(curves: xr.Dataset) -> list[Line2D]:
    """Legend entries of the quantiles."""
    quantiles = curves["quantile"].values
    return [
        Line2D([], [], color=colour, label=f"{100 * quantile:.0f} %")
        for quantile, colour in zip(quantiles, colours(len(quantiles)), strict=True)
    ]


def words(ax: Axes, parameter: xr.Dataset, lost: NDArray[np.bool_]) -> None:
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


def limits(values: FloatArray) -> tuple[float, float]:
    """Of the vertical axis that all panels share; values of curves that failed are NaN."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0.0, 1.0
    margin = MARGIN * float(np.ptp(finite))
    return float(finite.min()) - margin, float(finite.max()) + margin


def label_outer(axes: list[Axes], label: str) -> None:
    """Of panels that share both axes, label those with no panel below or none left of them."""
    columns = axes[0].get_gridspec().ncols
    for k, ax in enumerate(axes):
        if k + columns < len(axes):
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel(label)
