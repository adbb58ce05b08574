"""What stands above a panel: a name, what it is, and flags."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from deabayes.figures import style
from deabayes.figures.panels import CYCLES_SHOWN, Record, after_last_gap
from deabayes.quantities import ROLES, plain

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
