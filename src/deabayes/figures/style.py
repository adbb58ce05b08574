"""Style of all figures: sizes for journal columns, colours safe for colour-blind readers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

MILLIMETRE = 1 / 25.4
DOUBLE_COLUMN = 183 * MILLIMETRE
HEADER = 0.22
"""Height in inches above the axes for the study's name and the marks."""

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
GREY, LIGHT_GREY = "#6b6b6b", "#d9d9d9"
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
BANDS = {
    "predictive": ("#dcdcdc", "90 % predictive: parameters + discrepancy + noise"),
    "discrepancy": ("#f3c766", "90 % with model discrepancy"),
    "parameter": (SKY, "90 % parameters only (not predictive)"),
}
"""Colour and label of each band, widest first so that narrower bands are drawn on top."""

SETTINGS = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 7.0,
    "axes.labelsize": 7.0,
    "axes.titlesize": 7.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": matplotlib.cycler(color=SERIES),
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.useoffset": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.0,
    "patch.linewidth": 0.5,
    "figure.dpi": 300,
    "savefig.dpi": "figure",
    "svg.fonttype": "path",
    "svg.hashsalt": "deabayes",
}


@contextmanager
def applied() -> Iterator[None]:
    """Set matplotlib's defaults for the duration of a `with` block."""
    with matplotlib.rc_context(SETTINGS):
        yield


def mark_simulated(target: Axes | Figure) -> None:
    """Write "simulated data" in the upper right corner, outside the data."""
    style = {"fontsize": 6.5, "color": VERMILLION, "style": "italic", "ha": "right"}
    if isinstance(target, Figure):
        height = target.get_size_inches()[1]
        target.text(0.995, 1 - 0.05 / height, "simulated data", va="top", **style)
    else:
        target.text(1.0, 1.01, "simulated data", va="bottom", transform=target.transAxes, **style)


def watermark_unconverged(figure: Figure) -> None:
    """Write NOT CONVERGED across the figure, because its numbers cannot be trusted."""
    width, height = figure.get_size_inches()
    figure.text(
        0.5,
        0.5,
        "NOT CONVERGED",
        fontsize=min(5.2 * width, 22 * height),
        color=VERMILLION,
        alpha=0.28,
        weight="bold",
        ha="center",
        va="center",
        rotation=25 if height > 0.4 * width else 10,
        zorder=1000,
    )


def header(figure: Figure, text: str) -> None:
    """Write `text` in a strip above the axes, which is kept free.

    The layout is computed here once, and not again for every file that is written.
    """
    height = figure.get_size_inches()[1]
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0, 0, 1, 1 - HEADER / height))
        engine.execute(figure)
        figure.set_layout_engine("none")
    figure.text(0.005, 1 - 0.05 / height, text, fontsize=6.5, color=GREY, va="top")


def write(figure: Figure, svg: Path, png: Path) -> None:
    """Write the figure as SVG and PNG.

    `Figure.savefig` would draw each file twice, to find a layout that is already known.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    FigureCanvasAgg(figure).print_png(png)  # PNG first: writing the SVG changes the resolution
    FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None})
