"""Draw the three 90 % bands of a prediction, with the edges of the predictive band on top."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.record import Axis, Record, branches

EDGE_COLOUR, EDGE_WIDTH = style.GREY, 0.5
"""Edges of the predictive band, which the discrepancy band fills if white noise is small."""


def handles(observed: str = "observed") -> list[Line2D | Patch]:
    """Legend entries of observed points, median and bands."""
    edge = {"edgecolor": EDGE_COLOUR, "linewidth": EDGE_WIDTH}
    return [
        panels.key(observed, marker="."),
        panels.key("posterior median", style.BLUE, linewidth=1.1),
        *(
            Patch(facecolor=colour, label=label, **(edge if name == "predictive" else {}))
            for name, (colour, label) in style.BANDS.items()
        ),
    ]


def draw(ax: Axes, record: Record, x: Axis, minus: FloatArray | float = 0.0) -> None:
    """Draw the bands of a record after subtracting `minus` (the median, for residuals)."""
    fill(ax, x.values, {name: record.band(name) - minus for name in style.BANDS})


def fill(ax: Axes, x: FloatArray, ends: Mapping[str, FloatArray]) -> None:
    """Draw bands along `x`, widest first, with the edges of the predictive band on top.

    `ends` holds the lower and upper end (2, N) of each band. `x` need not be monotone.
    """
    for name, (colour, _) in style.BANDS.items():
        lower, upper = ends[name]
        for part in branches(x):
            ax.fill_between(x[part], lower[part], upper[part], color=colour, linewidth=0.4)
    for edge in ends["predictive"]:
        ax.plot(x, edge, color=EDGE_COLOUR, linewidth=EDGE_WIDTH, zorder=1.5)
