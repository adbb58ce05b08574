"""Small multiples: sheets of panels, their headings, records and curves in them."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import (
    FixedLocator,
    Locator,
    LogFormatterMathtext,
    MaxNLocator,
    NullFormatter,
)

from deabayes.experiment import FloatArray
from deabayes.figures import style
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import ROLES, DisplayUnit, display_unit, plain

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


LINES = ("-", "--", "-.", ":")
BAND = "5–95 % of the draws"


def colour(index: int) -> str:
    """Of the index-th candidate of a study."""
    return style.SERIES[index % len(style.SERIES)]


def line(index: int) -> str:
    """Line style of the index-th candidate, for where colours are lost."""
    return LINES[index % len(LINES)]


def marker(index: int) -> str:
    """Marker of the index-th candidate; another one where its colour comes round again."""
    return style.MARKERS[(index + index // len(style.SERIES)) % len(style.MARKERS)]


def names(curves: xr.Dataset) -> list[str]:
    """Candidates of a data set, those that did not converge named so."""
    pairs = zip(curves["candidate"].values, curves["converged"].values, strict=True)
    return [str(name) + ("" if converged else " (not converged)") for name, converged in pairs]


def draw_candidate(ax: Axes, x: FloatArray, bands: FloatArray, index: int) -> None:
    """Median and band of one candidate from (bound, N): lower, median, upper."""
    lower, median, upper = bands
    ax.fill_between(x, lower, upper, color=colour(index), alpha=0.22, linewidth=0)
    ax.plot(x, median, color=colour(index), linestyle=line(index), linewidth=1.0)


def fill_loop(ax: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, index: int) -> None:
    """Band of a loop, branch by branch: those of the two branches may overlap."""
    for part in branches(x):
        ax.fill_between(x[part], lower[part], upper[part], color=colour(index), alpha=0.22,
                        linewidth=0)  # fmt: skip


def handles(curves: xr.Dataset, measured: bool = True) -> list[Line2D | Patch]:
    """Legend entries: measured, each candidate, the band."""
    entries: list[Line2D | Patch] = []
    if measured:
        entries.append(Line2D([], [], color=style.BLACK, marker="o", markersize=2.5,
                              linestyle="none", label="measured"))  # fmt: skip
    entries += [
        Line2D([], [], color=colour(k), linestyle=line(k), linewidth=1.0, label=name)
        for k, name in enumerate(names(curves))
    ]
    return [*entries, Patch(color=style.GREY, alpha=0.25, label=BAND)]


def by_size(curves: Sequence[xr.Dataset], key: str) -> list[xr.Dataset]:
    """Data sets by an attribute, largest first."""
    return sorted(curves, key=lambda each: -float(each.attrs[key]))


def spread(index: int, count: int, width: float = 0.22) -> float:
    """Where the index-th of `count` candidates stands beside a category."""
    return 0.0 if count == 1 else float(np.linspace(-width, width, count)[index])


LARGE, SMALL = 7.0, 6.0
BOLD, LIGHT = 0.68, 0.56
"""Mean width of a character, of its size."""
LINE = 8.0
"""Points from one line to the next."""
BESIDE = 0.35
"""Inches of a panel's share of the figure that its labels take."""
EXTRAPOLATION = "EXTRAPOLATION"


def title(ax: Axes, record: Record, whole: bool = False, role: str = "") -> None:
    """Name, role and protocol of a record above its panel, and the extrapolation flag.

    `whole` says that what the panel shows of the record is said elsewhere; `role` is said instead
    of the record's own.
    """
    attributes = record.prediction.attrs
    words = role or str(ROLES.get(str(attributes["role"]), attributes["role"]))
    if not record.name.startswith(record.protocol):
        words += f", {plain(record.protocol)}"
    if record.shown.start and not whole:
        gaps = after_last_gap(record.prediction["coordinate"].values) > 0
        words += ", last cycle kept" if gaps else f", last {CYCLES_SHOWN} cycles"
    heading(ax, record.name, words, EXTRAPOLATION if record.extrapolation else "")


def heading(ax: Axes, name: str, words: str, flag: str = "") -> None:
    """A bold name over grey words, on as many lines as it needs; a flag to their right or below."""
    width = _width(ax)
    size = LARGE if len(name) * BOLD * LARGE <= width else SMALL
    beside = len(words) * LIGHT * SMALL + (len(flag) + 1) * BOLD * SMALL * 1.15 <= width
    lift = LINE if flag and not beside else 0.0
    lines = wrapped(name, int(width / (BOLD * size)))
    ax.set_title(lines, loc="left", fontsize=size, pad=12.5 + lift, weight="bold")
    place = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "bottom"}
    ax.annotate(words, (0, 1), (0, 2.5 + lift), fontsize=SMALL, color=style.GREY, **place)
    if flag:
        at, side = (1, "right") if beside else (0, "left")
        mark = {"fontsize": SMALL, "color": style.VERMILLION, "ha": side, "weight": "bold"}
        ax.annotate(flag, (at, 1), (0, 2.5), **place, **mark)


def room(records: Sequence[Record]) -> float:
    """Inches by which panels three abreast must be higher for the longest name's further lines."""
    longest = max(len(record.name) for record in records)
    width = 72.0 * (style.DOUBLE_COLUMN / 3 - BESIDE)
    return float(np.floor(longest * BOLD * SMALL / width) * LINE / 72.0)


def wrapped(name: str, characters: int) -> str:
    """A name on lines of at most so many characters, broken behind its underscores."""
    lines = textwrap.wrap(name.replace("_", "_ "), max(characters, 8))
    return "\n".join(line.replace("_ ", "_") for line in lines)


def _width(ax: Axes) -> float:
    """Points that a panel has about as its own, before the figure is laid out."""
    place, figure = ax.get_subplotspec(), ax.figure
    columns = place.get_gridspec().ncols if place is not None else 1
    return float(72.0 * (figure.get_size_inches()[0] / columns - BESIDE))


WITHIN_DECADES = ((1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))
"""Where a decade may have ticks, from fine to coarse."""

WIDE = 20.0
"""Factor between values beyond which the smallest cannot be told apart on a linear axis."""


def spans_much(values: FloatArray) -> bool:
    """Whether positive values differ so much that a linear axis would hide the small ones."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min())


def set_horizontal(ax: Axes, x: Axis) -> None:
    """Label and scale of the horizontal axis."""
    ax.set_xlabel(x.label)
    if x.logarithmic:
        logarithmic(ax, x.values)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))


def logarithmic(
    ax: Axes, values: FloatArray, ticks: int = 5, which: Literal["x", "y"] = "x"
) -> None:
    """A logarithmic axis over `values`, horizontal unless told, with two to `ticks` labels."""
    positive = values[values > 0]
    low, high = (positive.min(), positive.max()) if positive.size else (1.0, 10.0)
    axis = ax.xaxis if which == "x" else ax.yaxis
    ax.set(**{f"{which}scale": "log"})
    if high >= 100.0 * low:
        axis.set_major_locator(_powers(low, high, ticks))
        axis.set_major_formatter(LogFormatterMathtext())
    else:
        axis.set_major_locator(_fractions(low, high, ticks))
        axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def _powers(low: float, high: float, ticks: int) -> Locator:
    """Powers of ten, so many apart that few lie between the limits, and the next ones beyond."""
    first, last = np.ceil(np.log10(low)), np.floor(np.log10(high))
    step = np.ceil((last - first) / (ticks - 1))
    return FixedLocator(10.0 ** np.arange(first - step, last + 2 * step, step))


def _fractions(low: float, high: float, ticks: int) -> Locator:
    """Round places of less than two decades; equidistant ones where no two are between."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)) - 1, np.ceil(np.log10(high)) + 1)
    for parts in WITHIN_DECADES:
        places = np.outer(decades, parts).ravel()
        if 2 <= np.sum((places >= low) & (places <= high)) <= ticks:
            return FixedLocator(places)
    return MaxNLocator(ticks, min_n_ticks=2)
