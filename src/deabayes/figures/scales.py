"""Horizontal and vertical scales with few, readable ticks, and never a lone one."""

from __future__ import annotations

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import (
    FixedLocator,
    Locator,
    LogFormatterMathtext,
    MaxNLocator,
    NullFormatter,
)

from deabayes.experiment import FloatArray
from deabayes.figures.panels import Axis

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
