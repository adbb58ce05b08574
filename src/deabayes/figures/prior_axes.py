"""The horizontal axis of curves that the analysis `influence` computed."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.figures import panels
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import DisplayUnit, display_unit, plain, short

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
