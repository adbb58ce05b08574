"""Which material parameters the data can tell apart only together."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import FloatArray
from deabayes.figures import style
from deabayes.figures.quantities import display_unit, symbol_text
from deabayes.figures.results import CandidateResults

SCOPE = "candidate"
TITLE = "Pairs of parameters"
CAPTION = (
    "Joint posterior of the material parameters: regions holding 50 % and 90 % of the draws. A "
    "thin slanted ellipse means that the data fix a combination of the two rather than each."
)
LARGEST = 12
DRAWS = 20000
BINS = 32


def draw(results: CandidateResults) -> list[Figure]:
    """One matrix of twelve parameters at the most; a second one of the last twelve if more."""
    names = results.names("material", "specimen")
    if len(names) < 2:
        return []
    blocks = [names[:LARGEST]] + ([names[-LARGEST:]] if len(names) > LARGEST else [])
    return [_matrix(results, block) for block in blocks]


def _matrix(results: CandidateResults, names: list[str]) -> Figure:
    count = len(names)
    side = style.DOUBLE_COLUMN if count > 4 else style.DOUBLE_COLUMN * (0.35 + 0.13 * count)
    figure = Figure(figsize=(side, side + style.HEADER))
    figure.subplots_adjust(
        left=0.62 / side, right=1 - 0.12 / side, bottom=0.62 / (side + style.HEADER),
        top=1 - (style.HEADER + 0.05) / (side + style.HEADER), wspace=0.12, hspace=0.12,
    )  # fmt: skip
    axes = figure.subplots(count, count, squeeze=False, sharex="col")
    columns = [_column(results, name) for name in names]
    size = 6.5 if count <= 8 else 5.5
    for row in range(count):
        for column in range(count):
            ax = axes[row, column]
            if column > row:
                ax.remove()
                continue
            _cell(ax, columns[column], columns[row] if column < row else None)
            _label(ax, columns, row, column, size)
    return figure


def _column(results: CandidateResults, name: str) -> tuple[FloatArray, str]:
    """Draws in display units, thinned for drawing, and the axis label."""
    values = np.asarray(results.posterior[name].values, dtype=float).ravel()
    values = values[:: max(values.size // DRAWS, 1)]
    label = results.label(name)
    unit = display_unit(label["unit"], np.nanmedian(values), name)
    text = symbol_text(name, label["symbol"])
    return values / unit.factor, text + (f"\n({unit.label})" if unit.label else "")


def _cell(ax: Axes, x: tuple[FloatArray, str], y: tuple[FloatArray, str] | None) -> None:
    limits = np.array(_limits(x[0][np.isfinite(x[0])], 0.002))
    if limits[0] == limits[1]:
        limits = limits + np.array([-0.5, 0.5])
    if y is None:
        ax.hist(x[0], BINS, range=tuple(limits), color=style.BLUE, alpha=0.6, histtype="stepfilled")
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
    else:
        contours(ax, x[0], y[0])
    ax.set_xlim(*limits)


def contours(ax: Axes, x: FloatArray, y: FloatArray) -> None:
    """Filled regions of highest density holding 50 % and 90 % of the points."""
    from scipy.ndimage import gaussian_filter

    kept = np.isfinite(x) & np.isfinite(y)
    ranges = [_limits(v[kept], 0.001) for v in (x, y)]
    if any(low == high for low, high in ranges):
        return
    density, x_edges, y_edges = np.histogram2d(x[kept], y[kept], BINS, range=ranges)
    density = gaussian_filter(np.pad(density, 2), 1.4)
    ordered = np.sort(density.ravel())[::-1]
    held = np.cumsum(ordered) / kept.sum()
    last = ordered.size - 1
    outer, inner = (float(ordered[min(int(np.searchsorted(held, p)), last)]) for p in (0.9, 0.5))
    centres = [_padded(0.5 * (edges[1:] + edges[:-1])) for edges in (x_edges, y_edges)]
    if outer < inner < density.max():
        ax.contourf(*centres, density.T, [outer, inner, density.max()],
                    colors=["#a6d3ee", style.BLUE])  # fmt: skip
    ax.set_ylim(*ranges[1])


def _limits(values: FloatArray, tail: float) -> tuple[float, float]:
    """Between the tails' quantiles; where these are far out, the 5 to 95 % range three times."""
    low, inner_low, inner_high, high = np.quantile(values, [tail, 0.05, 0.95, 1.0 - tail])
    width = inner_high - inner_low
    return max(low, inner_low - width), min(high, inner_high + width)


def _padded(centres: FloatArray) -> FloatArray:
    step = centres[1] - centres[0]
    return centres[0] + step * np.arange(-2, centres.size + 2)


def _label(
    ax: Axes, columns: list[tuple[FloatArray, str]], row: int, column: int, size: float
) -> None:
    last, few = row == len(columns) - 1, 3 if len(columns) <= 9 else 2
    ax.tick_params(labelsize=size - 1, length=1.5, pad=1.5)
    ax.xaxis.set_major_locator(MaxNLocator(few, min_n_ticks=2, prune="upper"))
    ax.tick_params(axis="x", labelbottom=last, rotation=45)
    if column < row:
        ax.yaxis.set_major_locator(MaxNLocator(few, min_n_ticks=2, prune="upper"))
        ax.tick_params(axis="y", labelleft=column == 0)
    if last:
        ax.set_xlabel(columns[column][1], fontsize=size)
        ax.xaxis.set_label_coords(0.5, -0.33 / ax.get_window_extent().height * ax.figure.dpi)
    if column == 0 and row > 0:
        ax.set_ylabel(columns[row][1], fontsize=size)
        ax.yaxis.set_label_coords(-0.36 / ax.get_window_extent().width * ax.figure.dpi, 0.5)
