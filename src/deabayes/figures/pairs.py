"""Joint posterior of each pair of material and specimen parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import display_unit, symbol_text

SCOPE = "candidate"
TITLE = "Pairs of parameters"
CAPTION = (
    "Joint posterior of the material's parameters and the specimen's quantities: regions holding "
    "50 % and 90 % of the draws. A thin slanted region means that the data fix a combination of "
    "the two rather than each. Axes are logarithmic where the draws span more than a factor of "
    "five."
)
LARGEST = 12
DRAWS = 20000
BINS = 32
WIDE = 5.0
"""Ratio of the 95 % to the 5 % quantile above which an axis is logarithmic."""


def draw(results: CandidateResults) -> list[Figure]:
    """Return a matrix of the first twelve parameters, and of the last twelve if there are more."""
    names = results.names("material", "specimen")
    if len(names) < 2:
        return []
    blocks = [names[:LARGEST]] + ([names[-LARGEST:]] if len(names) > LARGEST else [])
    return [_matrix(results, block) for block in blocks]


def _matrix(results: CandidateResults, names: list[str]) -> Figure:
    count = len(names)
    side = style.DOUBLE_COLUMN if count > 4 else style.DOUBLE_COLUMN * (0.35 + 0.13 * count)
    figure = Figure(figsize=(side, side))
    figure.subplots_adjust(
        left=0.62 / side, right=1 - 0.12 / side, bottom=0.62 / side, top=1 - 0.05 / side,
        wspace=0.12, hspace=0.12,
    )  # fmt: skip
    axes = figure.subplots(count, count, squeeze=False, sharex="col")
    columns = [_column(results, name) for name in names]
    size = 6.5 if count <= 8 else 6.0
    for row in range(count):
        for column in range(count):
            ax = axes[row, column]
            if column > row:
                ax.remove()
                continue
            _cell(ax, columns[column], columns[row] if column < row else None)
            _label(ax, columns, row, column, size)
    return figure


@dataclass(frozen=True)
class _Column:
    """Draws of one parameter for the plot, in display units or their logarithm to base ten."""

    drawn: FloatArray
    label: str
    log: bool

    def limits(self, tail: float) -> tuple[float, float]:
        """Limits at the `tail` quantiles, at most one width of the 5 to 95 % range beyond it."""
        values = self.drawn[np.isfinite(self.drawn)]
        low, inner_low, inner_high, high = np.quantile(values, [tail, 0.05, 0.95, 1.0 - tail])
        width = inner_high - inner_low
        return max(low, inner_low - width), min(high, inner_high + width)

    def on_axis(self, drawn: FloatArray) -> FloatArray:
        """Convert plotted values to values on the axis."""
        return np.power(10.0, drawn) if self.log else drawn


def _column(results: CandidateResults, name: str) -> _Column:
    """Return the thinned draws of a parameter with its axis label."""
    values = np.asarray(results.posterior[name].values, dtype=float).ravel()
    values = values[:: max(values.size // DRAWS, 1)]
    label = results.label(name)
    unit = display_unit(label["unit"], np.nanmedian(values), name)
    text = symbol_text(name, label["symbol"]) + (f"\n({unit.label})" if unit.label else "")
    values = values / unit.factor
    low, high = np.nanquantile(values, [0.05, 0.95])
    log = bool(np.nanmin(values) > 0 and high > WIDE * low)
    return _Column(np.log10(values) if log else values, text, log)


def _cell(ax: Axes, x: _Column, y: _Column | None) -> None:
    limits = np.array(x.limits(0.002))
    if limits[0] == limits[1]:
        limits = limits + np.array([-0.5, 0.5])
    if y is None:
        heights, edges = np.histogram(x.drawn, BINS, range=tuple(limits))
        ax.stairs(heights, x.on_axis(edges), fill=True, color=style.BLUE, alpha=0.6)
        ax.set_ylim(bottom=0)
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
    else:
        _contours(ax, x, y)
    ax.set_xlim(*x.on_axis(limits))


def _contours(ax: Axes, x: _Column, y: _Column) -> None:
    """Draw filled regions of highest density that hold 50 % and 90 % of the draws."""
    from scipy.interpolate import RegularGridInterpolator
    from scipy.ndimage import gaussian_filter

    kept = np.isfinite(x.drawn) & np.isfinite(y.drawn)
    ranges = [column.limits(0.001) for column in (x, y)]
    if any(low == high for low, high in ranges):
        return
    density, *edges = np.histogram2d(x.drawn[kept], y.drawn[kept], BINS, range=ranges)
    density = gaussian_filter(np.pad(density, 2), 1.4)
    centres = [_padded(0.5 * (each[1:] + each[:-1])) for each in edges]
    drawn = np.column_stack([x.drawn[kept], y.drawn[kept]])
    at_draws = RegularGridInterpolator(centres, density, bounds_error=False, fill_value=0.0)(drawn)
    outer, inner = np.quantile(at_draws, [0.1, 0.5])
    shown = [column.on_axis(each) for column, each in zip((x, y), centres, strict=True)]
    if 0.0 < outer < inner < density.max():
        ax.contourf(*shown, density.T, [outer, inner, density.max()],
                    colors=["#a6d3ee", style.BLUE])  # fmt: skip
    ax.set_ylim(*y.on_axis(np.array(ranges[1])))


def _padded(centres: FloatArray) -> FloatArray:
    step = centres[1] - centres[0]
    return centres[0] + step * np.arange(-2, centres.size + 2)


def _ticks(ax: Axes, column: _Column, which: Literal["x", "y"], few: int) -> None:
    if column.log:
        panels.logarithmic(ax, column.on_axis(np.array(column.limits(0.002))), few, which)
    else:
        axis = ax.xaxis if which == "x" else ax.yaxis
        axis.set_major_locator(MaxNLocator(few, min_n_ticks=2, prune="upper"))


def _label(ax: Axes, columns: list[_Column], row: int, column: int, size: float) -> None:
    last, few = row == len(columns) - 1, 3 if len(columns) <= 9 else 2
    ax.tick_params(labelsize=6.0, length=1.5, pad=1.5)
    _ticks(ax, columns[column], "x", few)
    ax.tick_params(axis="x", labelbottom=last, rotation=45)
    for tick in ax.get_xticklabels():
        tick.set(ha="right", rotation_mode="anchor")  # so that a label ends below its tick
    if column < row:
        _ticks(ax, columns[row], "y", few)
        ax.tick_params(axis="y", labelleft=column == 0)
    if last:
        ax.set_xlabel(columns[column].label, fontsize=size)
        ax.xaxis.set_label_coords(0.5, -0.33 / ax.get_window_extent().height * ax.figure.dpi)
    if column == 0 and row > 0:
        ax.set_ylabel(columns[row].label, fontsize=size)
        ax.yaxis.set_label_coords(-0.36 / ax.get_window_extent().width * ax.figure.dpi, 0.5)
