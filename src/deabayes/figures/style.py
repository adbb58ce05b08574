"""Style of all figures: sizes for journal columns, colours safe for colour-blind readers."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

import deabayes

MILLIMETRE = 1 / 25.4
DOUBLE_COLUMN = 183 * MILLIMETRE
HEADER = 0.22
"""Height in inches above the axes for the name and the mark of a figure, if it has them."""

DIGITS = 9
"""Digits of the places of panels, as shares of the figure."""

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

FONTS = ("DejaVu Sans", "Verdana", "Arial", "Helvetica")
"""The font of all text, which comes with matplotlib, then those that show an SVG without it."""
FONT_OF_SYMBOLS = re.compile(r"font-family: '[^',]+'(?=[;\"])")
"""The font of mathematical text in an SVG, for which matplotlib names no other fonts."""
OTHER_FONTS = ", ".join([*map(repr, FONTS[1:]), "sans-serif"])

SETTINGS = {
    "font.family": "sans-serif",
    "font.sans-serif": list(FONTS),
    "mathtext.fontset": "dejavusans",
    "font.size": 7.0,
    "axes.labelsize": 7.0,
    "axes.titlesize": 7.0,
    "figure.titlesize": 7.0,
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
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "svg.hashsalt": "deabayes",
}


@contextmanager
def applied() -> Iterator[None]:
    """Set matplotlib's defaults for the duration of a `with` block."""
    with matplotlib.rc_context(SETTINGS):
        yield


def watermark_unconverged(figure: Figure) -> None:
    """Write NOT CONVERGED across the figure, because its numbers cannot be trusted."""
    watermark(figure, "NOT CONVERGED")


def watermark(figure: Figure, words: str) -> None:
    """Write words across the figure that say why its numbers are not results."""
    width, height = figure.get_size_inches()
    figure.text(
        0.5,
        0.5,
        words,
        fontsize=min(5.2 * width, 22 * height),
        color=VERMILLION,
        alpha=0.28,
        weight="bold",
        ha="center",
        va="center",
        rotation=25 if height > 0.4 * width else 10,
        zorder=1000,
    )


def finish(figure: Figure, name: str = "", simulated: bool = False) -> None:
    """Lay the figure out, once for all files, with a strip above the axes for name and mark.

    A figure with neither of them has no strip. A figure's title has room for both beside it.
    """
    strip = HEADER if (name or simulated) and not figure.get_suptitle() else 0.0
    width, height = figure.get_size_inches()
    share = height / (height + strip)
    figure.set_size_inches(width, height + strip)
    engine = figure.get_layout_engine()
    if engine is None:
        edges = figure.subplotpars
        figure.subplots_adjust(bottom=share * edges.bottom, top=share * edges.top)
    else:
        engine.set(rect=(0, 0, 1, share))
        engine.execute(figure)
        figure.set_layout_engine("none")
        _round_layout(figure)
    above: dict[str, Any] = {"y": 1 - 0.05 / (height + strip), "fontsize": 6.5, "va": "top"}
    if name:
        figure.text(x=0.005, s=name, color=GREY, **above)
    if simulated:
        figure.text(x=0.995, s="simulated data", color=VERMILLION, style="italic", ha="right",
                    **above)  # fmt: skip


def _round_layout(figure: Figure) -> None:
    """Round the places of all panels, whose last digits differ from run to run.

    The names of clipping regions in an SVG depend on every digit.
    """
    for part in figure.subfigs:
        part.bbox_relative.set_points(part.bbox_relative.get_points().round(DIGITS))
    for ax in figure.axes:
        place = ax.get_position(original=True)
        ax.set_position(Bbox(place.get_points().round(DIGITS)))


def write(figure: Figure, stem: Path, title: str, keywords: Sequence[str]) -> None:
    """Write the figure as `stem`.svg, .png and .pdf, with its title and keywords as metadata.

    `Figure.savefig` would draw each file twice, to find a layout that is already known.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    said = {"Title": title, "Creator": f"deabayes {deabayes.__version__}"}
    words = {"Keywords": ", ".join(keywords)}
    resolution, text = figure.dpi, io.StringIO()
    FigureCanvasAgg(figure).print_png(f"{stem}.png", metadata=said | words)
    FigureCanvasPdf(figure).print_pdf(f"{stem}.pdf", metadata=said | words | {"CreationDate": None})
    figure.set_dpi(resolution)  # writing a PDF or an SVG changes it
    FigureCanvasSVG(figure).print_svg(text, metadata=said | {"Keywords": keywords, "Date": None})
    figure.set_dpi(resolution)
    svg = FONT_OF_SYMBOLS.sub(rf"\g<0>, {OTHER_FONTS}", text.getvalue())
    Path(f"{stem}.svg").write_text(svg, encoding="utf-8")
