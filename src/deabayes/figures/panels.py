"""Sheets of panels: layout, legends, headings, axes, and the curves of candidates."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, Literal, TypeVar

import numpy as np
import pandas as pd
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
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.figures import style
from deabayes.figures.record import CYCLES_SHOWN, Axis, Record, after_last_gap, branches
from deabayes.quantities import ROLES, plain

PANELS_PER_SHEET = 9
DENSE = 400
NO_RESPONSE = "no draw has a response"
Item = TypeVar("Item")
LINES = ("-", "--", "-.", ":")
BAND = "5–95 % of the draws"
LARGE, SMALL = 7.0, 6.0
BOLD, LIGHT = 0.68, 0.56
"""Mean width of a bold and of a light character, as a share of the font size."""
LINE = 8.0
"""Height of a line of text in points."""
BESIDE = 0.35
"""Width in inches that the labels of a panel take from its share of the figure."""
EXTRAPOLATION = "EXTRAPOLATION"
WITHIN_DECADES = ((1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))
"""Tick positions within a decade, from fine to coarse."""
WIDE = 20.0
"""Ratio of largest to smallest value above which a linear axis hides the smallest."""


def batches(items: Sequence[Item], size: int = PANELS_PER_SHEET) -> list[Sequence[Item]]:
    """Split items into sheets of nearly equal length, at most `size` each."""
    count = max(-(-len(items) // size), 1)
    edges = np.linspace(0, len(items), count + 1).round().astype(int)
    return [items[a:b] for a, b in pairwise(edges)]


def grid(
    rows: int, columns: int, height: float, width: float = 1.0, **options: Any
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with a grid of panels, and its axes (rows, columns).

    Parameters
    ----------
    height : of all rows together, in inches.
    width : share of the width of two columns of a journal.
    options : further arguments of matplotlib's `Figure.subplots`.
    """
    figure = Figure(figsize=(width * style.DOUBLE_COLUMN, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def cells(
    count: int, columns: int, height: float, width: float = 1.0, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` panels in rows of `columns`, and its axes (see `grid`)."""
    figure, axes = grid(-(-count // columns), columns, height, width, **options)
    for ax in axes.ravel()[count:]:
        ax.remove()
    return figure, list(axes.ravel()[:count])


def sheet(count: int, panel_height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` panels, at most three in a row, and its axes."""
    columns = min(count, 3) if count != 4 else 2
    if columns < 3:
        panel_height *= 1.25
    height = -(-count // columns) * panel_height + 0.35
    return cells(count, columns, height, 1.0 if columns > 1 else 0.7)


def name_rows(ax: Axes, names: Sequence[str], **text: Any) -> None:
    """Give every row of a panel its name; the first row is on top."""
    ax.set_yticks(range(len(names)), names, **text)
    ax.set_ylim(len(names) - 0.5, -0.5)


def shade_rows(ax: Axes, count: int) -> None:
    """Shade every second row of a panel."""
    for row in range(0, count, 2):
        ax.axhspan(row - 0.5, row + 0.5, color="#f4f4f4", zorder=0)


def rule(ax: Axes, axis: Literal["x", "y"] = "y") -> None:
    """Draw light lines across the panel at the ticks of an axis."""
    ax.grid(axis=axis, color=style.LIGHT_GREY, linewidth=0.4)
    ax.set_axisbelow(True)


def mark_limit(ax: Axes, value: float) -> None:
    """Draw a dashed vertical line at a limit."""
    ax.axvline(value, color=style.BLACK, linestyle="--", linewidth=0.8)


def key(label: str, colour: str = style.BLACK, **settings: Any) -> Line2D:
    """Return a legend entry: a line, or points if `marker` is given without `linestyle`."""
    if "marker" in settings:
        settings.setdefault("linestyle", "none")
    return Line2D([], [], color=colour, label=label, **settings)


def legend_below(figure: Figure, handles: Sequence[Artist], columns: int = 3) -> None:
    """Draw one legend below all panels, in at most `columns` columns that fit in the figure."""
    for count in range(min(columns, len(handles)), 0, -1):
        legend = figure.legend(handles=list(handles), loc="outside lower center", ncols=count)
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()


def labelled(*several: Axes) -> list[Artist]:
    """Return the labelled artists of these axes for a legend, one per label."""
    by_label: dict[str, Artist] = {}
    for ax in several:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            by_label.setdefault(label, handle)
    return list(by_label.values())


def say(ax: Axes, words: str) -> None:
    """Write words in the middle of a panel, for example that there is no response."""
    place = {"transform": ax.transAxes, "ha": "center", "va": "center"}
    ax.text(0.5, 0.5, words, fontsize=6.5, style="italic", color=style.VERMILLION, **place)


def record_sheets(
    records: Sequence[Record],
    millimetres: float,
    draw: Callable[[Axes, Record], None],
    entries: Sequence[Artist],
) -> list[Figure]:
    """Return sheets of at most nine records, with one legend below each sheet.

    Parameters
    ----------
    millimetres : height of a panel.
    draw : function that draws the panel of a record.
    """
    figures = []
    for group in batches(records) if records else []:
        figure, axes = sheet(len(group), millimetres * style.MILLIMETRE + room(group))
        for ax, record in zip(axes, group, strict=True):
            draw(ax, record)
        legend_below(figure, entries)
        figures.append(figure)
    return figures


def draw_observed(ax: Axes, x: FloatArray, y: FloatArray, size: float = 2.0) -> None:
    """Draw observed points; more than `DENSE` points are rasterized to keep vector files small."""
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


def draw_median(ax: Axes, record: Record, x: Axis, role: str = "") -> None:
    """Draw the median response, if there is one, and label the panel.

    A non-empty `role` replaces the record's own role in the title.
    """
    if record.responds:
        ax.plot(x.values, record.response("median"), color=style.BLUE, linewidth=1.1, zorder=4)
    else:
        say(ax, NO_RESPONSE)
    ax.set_ylabel(record.label)
    if record.spans_decades:
        ax.set_yscale("log")
    set_horizontal(ax, x)
    title(ax, record, role=role)


def colour(index: int) -> str:
    """Colour of the index-th candidate of a study."""
    return style.SERIES[index % len(style.SERIES)]


def line(index: int) -> str:
    """Line style of the index-th candidate, to tell candidates apart without colours."""
    return LINES[index % len(LINES)]


def marker(index: int) -> str:
    """Marker of the index-th candidate; it differs for candidates with the same colour."""
    return style.MARKERS[(index + index // len(style.SERIES)) % len(style.MARKERS)]


def marked(name: str, converged: bool) -> str:
    """Name of a candidate, marked if it did not converge."""
    return name if converged else f"{name} (not converged)"


def names(curves: xr.Dataset) -> list[str]:
    """Names of a data set's candidates, marked if they did not converge."""
    pairs = zip(curves["candidate"].values, curves["converged"].values, strict=True)
    return [marked(str(name), converged) for name, converged in pairs]


def draw_candidate(ax: Axes, x: FloatArray, bands: FloatArray, index: int) -> None:
    """Draw median and band of one candidate; `bands` (3, N) holds lower, median and upper."""
    lower, median, upper = bands
    ax.fill_between(x, lower, upper, color=colour(index), alpha=0.22, linewidth=0)
    ax.plot(x, median, color=colour(index), linestyle=line(index), linewidth=1.0)


def draw_candidates(ax: Axes, x: FloatArray, bands: FloatArray) -> None:
    """Draw median and band of every candidate; `bands` is (candidate, 3, N)."""
    for index, of_candidate in enumerate(bands):
        draw_candidate(ax, x, of_candidate, index)


def draw_loop(ax: Axes, x: FloatArray, bands: FloatArray, index: int) -> None:
    """Draw median and band (3, N) of a loop; its branches are filled separately, for overlap."""
    lower, median, upper = bands
    for part in branches(x):
        ax.fill_between(x[part], lower[part], upper[part], color=colour(index), alpha=0.22,
                        linewidth=0)  # fmt: skip
    ax.plot(x, median, color=colour(index), linestyle=line(index))


def draw_by_role(
    ax: Axes, x: FloatArray, y: FloatArray, calibrated: NDArray[np.bool_], **settings: Any
) -> None:
    """Draw points: filled for calibration records, open for held-out records."""
    settings = {"linestyle": "none", "markersize": 3.5, **settings}
    for part, fill in ((calibrated, settings["color"]), (~calibrated, "white")):
        ax.plot(x[part], y[part], markerfacecolor=fill, **settings)


def handles(curves: xr.Dataset, measured: bool = True) -> list[Line2D | Patch]:
    """Legend entries: measured, each candidate, the band."""
    entries = [key("measured", marker="o", markersize=2.5)] if measured else []
    entries += [
        key(name, colour(k), linestyle=line(k), linewidth=1.0)
        for k, name in enumerate(names(curves))
    ]
    return [*entries, Patch(color=style.GREY, alpha=0.25, label=BAND)]


def candidate_handles(table: pd.DataFrame) -> list[Line2D]:
    """Legend entries: the marker of each candidate in a table, and whether it converged."""
    pairs = table.drop_duplicates("candidate")[["candidate", "converged"]].to_numpy()
    return [
        key(marked(name, converged), colour(k), marker=marker(k))
        for k, (name, converged) in enumerate(pairs)
    ]


def role_handles(colour: str = style.BLACK, before: str = "", **settings: Any) -> list[Line2D]:
    """Legend entries of `draw_by_role`: filled points for calibration, open ones for held out."""
    return [
        key(before + words, colour, marker="o", markerfacecolor=fill, **settings)
        for words, fill in zip(ROLES.values(), (colour, "white"), strict=True)
    ]


def by_size(curves: Iterable[xr.Dataset], attribute: str) -> list[xr.Dataset]:
    """Data sets sorted by an attribute, largest first."""
    return sorted(curves, key=lambda each: -float(each.attrs[attribute]))


def place_of(name: str, curves: xr.Dataset) -> int:
    """Place of a candidate in a data set; 0 if the data set does not hold it."""
    candidates = curves["candidate"].values.tolist()
    return candidates.index(name) if name in candidates else 0


def spread(index: int, count: int, width: float = 0.22) -> float:
    """Offset of the index-th of `count` candidates from the centre of a category."""
    return 0.0 if count == 1 else float(np.linspace(-width, width, count)[index])


def title(ax: Axes, record: Record, whole: bool = False, role: str = "") -> None:
    """Write name, role and protocol of a record above its panel, and the extrapolation flag.

    `whole` leaves out the note on which cycles are shown. A non-empty `role` replaces the
    record's own role.
    """
    words = role or record.role
    if not record.name.startswith(record.protocol):
        words += f", {plain(record.protocol)}"
    if record.shown.start and record.protocol == "sine" and not whole:
        gaps = after_last_gap(record.prediction["coordinate"].values) > 0
        words += ", last cycle kept" if gaps else f", last {CYCLES_SHOWN} cycles"
    heading(ax, record.name, words, EXTRAPOLATION if record.extrapolation else "")


def name_and_role(record: xr.Dataset) -> str:
    """Name and role of the record of a prediction or of an analysis' data set."""
    return f"{record.attrs['experiment']}, {ROLES[str(record.attrs['role'])]}"


def heading(ax: Axes, name: str, words: str, flag: str = "") -> None:
    """Write a bold name above grey words, and a flag to the right of the words or below them."""
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
    """Extra panel height in inches if the longest name needs several lines."""
    longest = max(len(record.name) for record in records)
    width = 72.0 * (style.DOUBLE_COLUMN / 3 - BESIDE)
    return float(np.floor(longest * BOLD * SMALL / width) * LINE / 72.0)


def wrapped(name: str, characters: int) -> str:
    """Break a name after its underscores into lines of at most `characters` (minimum 8)."""
    lines = textwrap.wrap(name.replace("_", "_ "), max(characters, 8))
    return "\n".join(line.replace("_ ", "_") for line in lines)


def _width(ax: Axes) -> float:
    """Approximate width of a panel in points, before the layout is computed."""
    place, figure = ax.get_subplotspec(), ax.figure
    columns = place.get_gridspec().ncols if place is not None else 1
    return float(72.0 * (figure.get_size_inches()[0] / columns - BESIDE))


def spans_much(values: FloatArray) -> bool:
    """Whether positive values differ so much that a linear axis would hide the small ones."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min())


def set_horizontal(ax: Axes, x: Axis) -> None:
    """Set label and scale of the horizontal axis."""
    ax.set_xlabel(x.label)
    if x.logarithmic:
        logarithmic(ax, x.values)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))


def logarithmic(
    ax: Axes, values: FloatArray, ticks: int = 5, which: Literal["x", "y"] = "x"
) -> None:
    """Make an axis logarithmic over `values`, with two to `ticks` labels."""
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
    """Ticks at powers of ten: at most `ticks` between the limits, and the next ones beyond."""
    first, last = np.ceil(np.log10(low)), np.floor(np.log10(high))
    step = np.ceil((last - first) / (ticks - 1))
    return FixedLocator(10.0 ** np.arange(first - step, last + 2 * step, step))


def _fractions(low: float, high: float, ticks: int) -> Locator:
    """Ticks at round values within less than two decades; equidistant ticks if none fit.

    If every set has too few or too many values, some of the smallest set with too many are left
    out.
    """
    decades = 10.0 ** np.arange(np.floor(np.log10(low)) - 1, np.ceil(np.log10(high)) + 1)
    many = np.array([])
    for parts in WITHIN_DECADES:
        places = np.outer(decades, parts).ravel()
        inside = places[(places >= low) & (places <= high)]
        if 2 <= inside.size <= ticks:
            return FixedLocator(places)
        many = inside if inside.size > ticks else many
    if many.size:
        return FixedLocator(many[np.linspace(0, many.size - 1, ticks).round().astype(int)])
    return MaxNLocator(ticks, min_n_ticks=2)
