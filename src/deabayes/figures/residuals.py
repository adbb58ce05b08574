"""What the model leaves over, along each record and per noise group."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import plain

SCOPE = "candidate"
TITLE = "Residuals"
CAPTION = (
    "Observed minus posterior median, with the bands around it. A trend or a wave that fills the "
    "orange band is something the model does not contain. The last panel shows the residuals' "
    "spread per record: records that share one noise model should spread alike."
)


def draw(results: CandidateResults) -> list[Figure]:
    """Sheets of residuals along the coordinate, then their spread by noise group."""
    records = [panels.Record(p) for p in results.predictions.values()]
    sheets = [_sheet(group) for group in panels.batches(records) if group]
    return [*sheets, _spread(results, records)] if records else sheets


def _sheet(records: Sequence[panels.Record]) -> Figure:
    figure, axes = panels.sheet(len(records), 38 * style.MILLIMETRE)
    for ax, record in zip(axes, records, strict=True):
        x, median = record.against_coordinate(), record.response("median")
        panels.draw_bands(ax, record, x, minus=median)
        panels.draw_observed(ax, x.values, record.response("observed") - median)
        ax.axhline(0, color=style.BLUE, linewidth=1.1)
        ax.set_ylabel(f"residual{record.unit.suffix}")
        panels.set_horizontal(ax, x)
        panels.title(ax, record)
    panels.legend_below(figure, panels.band_handles())
    return figure


def _spread(results: CandidateResults, records: Sequence[panels.Record]) -> Figure:
    """Box of residuals in per cent of each record's range, coloured by noise group."""
    groups = {r.name: results.noise_group(r.name) for r in records}
    order = sorted(records, key=lambda r: (groups[r.name], r.name))
    colours = dict(
        zip(dict.fromkeys(groups[r.name] for r in order), 3 * style.SERIES, strict=False)
    )
    height = 0.16 * len(order) + 0.75 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    ax = figure.subplots()
    for row, record in enumerate(order):
        observed = record.response("observed")
        share = 100 * (observed - record.response("median")) / np.ptp(observed)
        colour = colours[groups[record.name]]
        ax.boxplot(
            share, positions=[row], orientation="horizontal", widths=0.6, whis=(5, 95),
            showfliers=False, patch_artist=True, medianprops={"color": style.BLACK},
            boxprops={"facecolor": colour, "alpha": 0.6}, label=_label(groups[record.name]),
        )  # fmt: skip
    ax.axvline(0, color=style.GREY, linewidth=0.6)
    ax.set_yticks(range(len(order)), [r.name for r in order])
    ax.invert_yaxis()
    ax.set_xlabel("residual (% of the record's range): box 50 %, whiskers 90 %")
    handles, labels = ax.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=4)
    return figure


def _label(group: str) -> str:
    return f"noise group {plain(group)}"
