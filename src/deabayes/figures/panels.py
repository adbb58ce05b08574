"""Small multiples: sheets of panels, and a record shown in one of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import style
from deabayes.passes import passes, usual_period
from deabayes.quantities import DisplayUnit, display_unit, plain

PANELS_PER_SHEET = 9
DENSE = 400
LOG_TIME_PROTOCOLS = ("relaxation", "creep", "frequency_response")
CYCLES_SHOWN = 3
NO_RESPONSE = "no draw has a response"
GAP = 3.0
"""Times the usual spacing of points."""
SMALLEST = 0.05
"""Of a unit: the smallest response that reads well in it."""
Item = TypeVar("Item")


def batches(items: Sequence[Item], size: int = PANELS_PER_SHEET) -> list[Sequence[Item]]:
    """Split into sheets of nearly equal length, `size` at most."""
    count = max(-(-len(items) // size), 1)
    edges = np.linspace(0, len(items), count + 1).round().astype(int)
    return [items[a:b] for a, b in pairwise(edges)]


def sheet(count: int, panel_height: float) -> tuple[Figure, list[Axes]]:
    """A double-column figure with `count` panels, three abreast at most."""
    columns = min(count, 3) if count != 4 else 2
    rows = -(-count // columns)
    width = style.DOUBLE_COLUMN if columns > 1 else 0.7 * style.DOUBLE_COLUMN
    if columns < 3:
        panel_height *= 1.25
    height = rows * panel_height + style.HEADER + 0.35
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax in axes[count:]:
        ax.remove()
    return figure, list(axes[:count])


def legend_below(figure: Figure, handles: Sequence[Artist], columns: int = 3) -> None:
    """One legend for all panels, below them, in as many columns as its labels leave room for."""
    for count in range(min(columns, len(handles)), 0, -1):
        legend = figure.legend(handles=list(handles), loc="outside lower center", ncols=count)
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()


def labelled(*several: Axes) -> list[Artist]:
    """What has a label in these axes, once per label, for a legend."""
    found: dict[str, Artist] = {}
    for ax in several:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values())


def say(ax: Axes, words: str) -> None:
    """Words in the middle of a panel that has nothing, or little, to show."""
    place = {"transform": ax.transAxes, "ha": "center", "va": "center"}
    ax.text(0.5, 0.5, words, fontsize=6.5, style="italic", color=style.VERMILLION, **place)


@dataclass(frozen=True)
class Axis:
    """Values to plot in display units, their label, and whether the axis is logarithmic."""

    values: FloatArray
    label: str
    logarithmic: bool = False


@dataclass(frozen=True)
class Record:
    """One prediction file, in display units.

    `shown` is the part that a panel shows: all of it, the last cycles of a long sine, or what
    follows the last gap of one that keeps some cycles only.
    """

    prediction: xr.Dataset
    log_time: bool | None = None
    beside: float = 0.0
    """Largest response of its kind among the records shown beside it (SI)."""

    @property
    def name(self) -> str:
        return str(self.prediction.attrs["experiment"])

    @property
    def protocol(self) -> str:
        return str(self.prediction.attrs["protocol"])

    @property
    def extrapolation(self) -> str:
        return str(self.prediction.attrs.get("extrapolation", ""))

    @property
    def response_name(self) -> str:
        return str(self.prediction.attrs["response_name"])

    @property
    def largest(self) -> float:
        """Magnitude of the observed response (SI)."""
        return float(np.nanmax(np.abs(self.prediction["observed"].values), initial=0.0))

    @property
    def unit(self) -> DisplayUnit:
        """That of the records beside it, its own where it would be next to nothing in theirs."""
        kind = str(self.prediction.attrs["response_unit"])
        theirs = display_unit(kind, max(self.largest, self.beside), self.response_name)
        if self.largest >= SMALLEST * theirs.factor:
            return theirs
        return display_unit(kind, self.largest, self.response_name)

    @property
    def label(self) -> str:
        return plain(self.response_name) + self.unit.suffix

    @property
    def spans_decades(self) -> bool:
        """Whether the response wants a logarithmic axis: a gain does."""
        return self.response_name == "gain"

    @property
    def responds(self) -> bool:
        """Whether there is a median, which there is not where every draw failed."""
        return bool(np.isfinite(self.prediction["median"].values).any())

    def whole(self, name: str, **selection: object) -> FloatArray:
        """A variable of the response's kind over the whole record, in its display unit."""
        variable = self.prediction[name].sel(**selection) if selection else self.prediction[name]
        return np.asarray(variable.values, dtype=float) / self.unit.factor

    def response(self, name: str, **selection: object) -> FloatArray:
        """The same of the part shown."""
        return self.whole(name, **selection)[..., self.shown]

    @property
    def shown(self) -> slice:
        time = self.prediction["coordinate"].values
        if self.protocol == "sine" and (last := after_last_gap(time)):
            return slice(last, None)
        crossings = passes(time, self.prediction["excitation"].values)
        if self.protocol != "sine" or len(crossings) <= CYCLES_SHOWN + 2:
            return slice(None)
        shown = CYCLES_SHOWN * usual_period(crossings)
        return slice(int(np.searchsorted(time, time[-1] - shown)), None)

    def against_coordinate(self) -> Axis:
        """Time, frequency, or the excitation of a record without time."""
        coordinate = self.prediction["coordinate"]
        values = coordinate.values[self.shown]
        logarithmic = self.log_time
        if logarithmic is None:
            positive = values[values > 0]
            logarithmic = (
                self.protocol in LOG_TIME_PROTOCOLS
                and positive.size > 0.9 * values.size
                and positive.max() > 30 * positive.min()
            )
        name = str(coordinate.attrs.get("name", "coordinate"))
        return _axis(values, name, _unit(coordinate), bool(logarithmic))

    def horizontal(self) -> Axis:
        """The excitation for a loop, else the coordinate."""
        if self.protocol != "load_unload":
            return self.against_coordinate()
        excitation = self.prediction["excitation"]
        name = str(excitation.attrs.get("name", excitation.attrs.get("long_name", "excitation")))
        return _axis(excitation.values[self.shown], name, _unit(excitation))


def side_by_side(predictions: Iterable[xr.Dataset], log_time: bool | None = None) -> list[Record]:
    """Records to be compared by eye: those of one response in one unit, where it suits them."""
    alone = [Record(prediction, log_time) for prediction in predictions]
    largest: dict[str, float] = {}
    for each in alone:
        name = each.response_name
        largest[name] = max(each.largest, largest.get(name, 0.0))
    return [replace(each, beside=largest[each.response_name]) for each in alone]


def _unit(variable: xr.DataArray) -> str:
    return str(variable.attrs.get("unit", variable.attrs.get("units", "1")))


def _axis(values: FloatArray, name: str, unit: str, logarithmic: bool = False) -> Axis:
    display = display_unit(unit, values, name)
    return Axis(values / display.factor, plain(name) + display.suffix, logarithmic)


def after_last_gap(coordinate: FloatArray) -> int:
    """Index of the first point behind the last gap between points; 0 where there is none."""
    steps = np.diff(coordinate)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) if steps.size else steps
    return int(gaps[-1]) + 1 if gaps.size else 0


def branches(values: FloatArray) -> Iterator[slice]:
    """Monotone stretches of `values`: the loading and unloading branches of a loop."""
    steps = np.sign(np.diff(values))
    steps = steps[steps != 0] if not steps.any() else _filled(steps)
    turns = np.flatnonzero(np.diff(steps)) + 1
    edges = [0, *turns.tolist(), len(values) - 1]
    for start, stop in pairwise(edges):
        yield slice(start, stop + 1)


def _filled(steps: FloatArray) -> FloatArray:
    """Zero steps take the sign of the step before them."""
    index = np.maximum.accumulate(np.where(steps != 0, np.arange(steps.size), 0))
    return steps[index]


def draw_observed(ax: Axes, x: FloatArray, y: FloatArray, size: float = 2.0) -> None:
    """Observed points; as pixels where they are many, so that a vector file stays small."""
    ax.plot(
        x,
        y,
        linestyle="none",
        marker="o",
        markersize=size if len(x) <= DENSE else 0.7 * size,
        markerfacecolor=style.BLACK,
        markeredgewidth=0,
        alpha=0.65,
        rasterized=len(x) > DENSE,
        zorder=3,
    )
