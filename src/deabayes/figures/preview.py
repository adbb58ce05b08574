"""Every record with the best fit of a preview, and how well it fits."""

from __future__ import annotations

from collections.abc import Iterable

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.record import Record, side_by_side

BAND = "90 % of readings, if the best fit were right"
E_RMS = "e_rms_percent"
"""Attribute of a prediction: root mean square error in per cent of the record's range."""


def draw(predictions: Iterable[xr.Dataset], name: str) -> list[Figure]:
    """Return one sheet per nine records, each with the watermark PREVIEW.

    Parameters
    ----------
    predictions : of the best fit, as in predictions/{experiment}.nc, with the attribute `E_RMS`.
    name : study and candidate, for the header.
    """
    entries = [
        panels.key("observed", marker="."),
        panels.key("best fit", style.BLUE, linewidth=1.1),
        Patch(facecolor=style.LIGHT_GREY, label=BAND),
    ]
    with style.applied():
        figures = panels.record_sheets(side_by_side(predictions), 44, _panel, entries)
        for figure in figures:
            style.finish(figure, f"{name}  ·  preview: best fit, not sampled")
            style.watermark(figure, "PREVIEW")
    return figures


def _panel(ax: Axes, record: Record) -> None:
    x = record.horizontal()
    panels.draw_observed(ax, x.values, record.response("observed"))
    if record.responds:
        low, high = record.band("predictive")
        ax.fill_between(x.values, low, high, color=style.LIGHT_GREY, linewidth=0.4)
    error = record.prediction.attrs[E_RMS]
    panels.draw_median(ax, record, x, f"{record.role}, e_rms {error:.2g} %")
