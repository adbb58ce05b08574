"""Model curves drawn from the prior, beside the calibration data."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.record import Record, side_by_side
from deabayes.figures.results import CandidateResults

SCOPE = "candidate"
TITLE = "What the prior held possible"
CAPTION = (
    "Model curves drawn from the prior (grey) and the calibration data (black). The data should "
    "lie among the curves; if they lie outside, the prior excludes what was measured."
)
CURVES = 50


def draw(results: CandidateResults) -> list[Figure]:
    """Return sheets of the records with prior curves."""

    def panel(ax: Axes, record: Record) -> None:
        x = record.horizontal()
        curves = drawn[record.name].values
        curves = curves.reshape(-1, curves.shape[-1])[:CURVES, record.shown] / record.unit.factor
        ax.plot(x.values, curves.T, color=style.GREY, linewidth=0.5, alpha=0.45, rasterized=True)
        observed = record.response("observed")
        panels.draw_observed(ax, x.values, observed)
        ax.set_ylim(*_limits(observed, curves))
        ax.set_ylabel(record.label)
        panels.set_horizontal(ax, x)
        panels.title(ax, record)

    drawn = results.prior_predictive
    records = side_by_side(p for n, p in results.predictions.items() if n in drawn)
    entries = [
        panels.key("drawn from the prior", style.GREY, linewidth=0.8),
        panels.key("observed", marker="."),
    ]
    return panels.record_sheets(records, 38, panel, entries)


def _limits(observed: FloatArray, curves: FloatArray) -> tuple[float, float]:
    """Vertical limits that show the data and most curves, but not the extreme ones."""
    finite = curves[np.isfinite(curves).all(axis=1)]
    low, high = float(observed.min()), float(observed.max())
    if finite.size:
        inner = np.quantile(finite, [0.05, 0.95])
        reach = 4 * (high - low)
        low = min(low, max(float(inner[0]), low - reach))
        high = max(high, min(float(inner[1]), high + reach))
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin
