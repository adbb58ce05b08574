"""Draw the three 90 % bands of a prediction, with the edges of the predictive band on top."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style

EDGE_COLOUR, EDGE_WIDTH = style.GREY, 0.5
"""Edges of the predictive band, which the discrepancy band fills if white noise is small."""
Intervals = Mapping[str, tuple[FloatArray, FloatArray]]
"""Lower and upper ends of each band."""


def handles(observed: str = "observed") -> list[Line2D | Patch]:
    """Legend entries of observed points, median and bands."""
    edge = {"edgecolor": EDGE_COLOUR, "linewidth": EDGE_WIDTH}
    return [
        Line2D([], [], color=style.BLACK, marker=".", linestyle="none", label=observed),
        Line2D([], [], color=style.BLUE, linewidth=1.1, label="posterior median"),
        *(
            Patch(facecolor=colour, label=label, **(edge if name == "predictive" else {}))
            for name, (colour, label) in style.BANDS.items()
        ),
    ]


def draw(ax: Axes, record: panels.Record, x: panels.Axis, minus: FloatArray | float = 0.0) -> None:
    """Draw the bands of a record after subtracting `minus` (the median, for residuals)."""
    ends = {
        name: (record.response(name, level=0.9, bound="lower") - minus,
               record.response(name, level=0.9, bound="upper") - minus)
        for name in style.BANDS
    }  # fmt: skip
    fill(ax, x.values, ends)


def fill(ax: Axes, x: FloatArray, ends: Intervals) -> None:
    """Draw bands along `x`, widest first, with the edges of the predictive band on top.

    `x` need not be monotone.
    """
    for name, (colour, _) in style.BANDS.items():
        lower, upper = ends[name]
        for part in panels.branches(x):
            ax.fill_between(x[part], lower[part], upper[part], color=colour, linewidth=0.4)
    for edge in ends["predictive"]:
        ax.plot(x, edge, color=EDGE_COLOUR, linewidth=EDGE_WIDTH, zorder=1.5)
