"""The three 90 % bands of a prediction, the predictive one seen also where another covers it."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style

EDGE_COLOUR, EDGE_WIDTH = style.GREY, 0.5
"""Of the predictive band: with little white noise that of the discrepancy fills all of it."""
Intervals = Mapping[str, tuple[FloatArray, FloatArray]]
"""Band -> its lower and its upper ends."""


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
    """Those of a record; `minus` is subtracted (the median, for residuals)."""
    ends = {
        name: (record.response(name, level=0.9, bound="lower") - minus,
               record.response(name, level=0.9, bound="upper") - minus)
        for name in style.BANDS
    }  # fmt: skip
    fill(ax, x.values, ends)


def fill(ax: Axes, x: FloatArray, ends: Intervals) -> None:
    """Bands along x, which may turn back, widest first; the predictive one's edges on top."""
    for name, (colour, _) in style.BANDS.items():
        lower, upper = ends[name]
        for part in panels.branches(x):
            ax.fill_between(x[part], lower[part], upper[part], color=colour, linewidth=0.4)
    for edge in ends["predictive"]:
        ax.plot(x, edge, color=EDGE_COLOUR, linewidth=EDGE_WIDTH, zorder=1.5)
