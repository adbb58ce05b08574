"""Curves of several candidates in one panel: colours, bands, legend entries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style

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
    for part in panels.branches(x):
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
