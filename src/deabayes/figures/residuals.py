"""Residuals along each record, and their spread by noise group."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import bands, panels, style
from deabayes.figures.record import Record, side_by_side
from deabayes.figures.results import CandidateResults
from deabayes.quantities import plain

SCOPE = "candidate"
TITLE = "Residuals"
CAPTION = (
    "Observed minus posterior median, with the bands around it, the predictive one up to the grey "
    "line. The horizontal axis is that of the data; records without a step are drawn along time. A "
    "trend or a wave that fills the orange band is something the model does not contain. "
    "The last panel shows the residuals' spread per record: records that share one noise model "
    "should spread alike."
)


def draw(results: CandidateResults) -> list[Figure]:
    """Return sheets of residuals along the coordinate, then their spread by noise group."""
    records = side_by_side(results.predictions.values())
    sheets = panels.record_sheets(records, 38, _panel, bands.handles())
    return [*sheets, _spread(results, records)] if records else []


def _panel(ax: Axes, record: Record) -> None:
    x = record.against_coordinate()
    if record.responds:
        median = record.response("median")
        bands.draw(ax, record, x, minus=median)
        panels.draw_observed(ax, x.values, record.response("observed") - median)
        ax.axhline(0, color=style.BLUE, linewidth=1.1)
        panels.set_horizontal(ax, x)
    else:
        ax.set(xlabel=x.label, xticks=[], yticks=[])
        panels.say(ax, panels.NO_RESPONSE)
    ax.set_ylabel(f"residual{record.unit.suffix}")
    panels.title(ax, record)


def _spread(results: CandidateResults, records: Sequence[Record]) -> Figure:
    """Draw boxes of residuals in per cent of each record's range, coloured by noise group."""
    groups = {r.name: results.noise_group(r.name) for r in records}
    order = sorted(records, key=lambda r: (groups[r.name], r.name))
    present = list(dict.fromkeys(groups[r.name] for r in order))
    figure, ((ax,),) = panels.grid(1, 1, 0.16 * len(order) + 0.75)
    for row, record in enumerate(order):
        _box(ax, row, record, present.index(groups[record.name]), groups[record.name])
    ax.axvline(0, color=style.GREY, linewidth=0.6)
    ax.set_yticks(range(len(order)), [r.name for r in order])
    ax.invert_yaxis()
    words = "residual (% of the record's range)\nbox 50 %, whiskers 90 %"
    if len(present) <= len(style.SERIES):
        panels.legend_below(figure, panels.labelled(ax), 4)
    else:
        words += "\nanother colour is another noise group"
    ax.set_xlabel(words)
    return figure


def _box(ax: Axes, row: int, record: Record, index: int, group: str) -> None:
    """Draw the box of a record's residuals, over all points and not only the shown cycles."""
    if not record.responds:
        ax.text(0.5, row, panels.NO_RESPONSE, transform=ax.get_yaxis_transform(), fontsize=6,
                ha="center", va="center", style="italic", color=style.VERMILLION)  # fmt: skip
        return
    observed = record.whole("observed")
    share = 100 * (observed - record.whole("median")) / np.ptp(observed)
    colour = style.SERIES[index % len(style.SERIES)]
    ax.boxplot(
        share[np.isfinite(share)], positions=[row], orientation="horizontal", widths=0.6,
        whis=(5, 95), showfliers=False, patch_artist=True, medianprops={"color": style.BLACK},
        boxprops={"facecolor": colour, "alpha": 0.6}, label=f"noise group {plain(group)}",
    )  # fmt: skip
