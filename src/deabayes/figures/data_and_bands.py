"""Every record with the model's median and its three 90 % bands."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from deabayes.figures import headings, panels, scales, style
from deabayes.figures.results import CandidateResults

SCOPE = "candidate"
TITLE = "Data and predictions"
CAPTION = (
    "Observed points, the posterior median and three separate 90 % bands. The blue band says how "
    "well the parameters are known; only the grey one says where new data would fall. Relaxation, "
    "creep and frequency responses over more than a factor of 30 on a logarithmic axis, gains on "
    "two, load–unload records as loops."
)


def draw(results: CandidateResults, log_time: bool | None = None) -> list[Figure]:
    """One sheet per nine records; `log_time` forces or forbids a logarithmic time axis."""
    records = [panels.Record(p, log_time) for p in results.predictions.values()]
    return [_sheet(group) for group in panels.batches(records) if group]


def _sheet(records: Sequence[panels.Record]) -> Figure:
    figure, axes = panels.sheet(len(records))
    for ax, record in zip(axes, records, strict=True):
        x = record.horizontal()
        panels.draw_bands(ax, record, x)
        panels.draw_observed(ax, x.values, record.response("observed"))
        if record.responds:
            ax.plot(x.values, record.response("median"), color=style.BLUE, linewidth=1.1, zorder=4)
        else:
            panels.say(ax, panels.NO_RESPONSE)
        ax.set_ylabel(record.label)
        if record.spans_decades:
            ax.set_yscale("log")
        scales.set_horizontal(ax, x)
        headings.title(ax, record)
    panels.legend_below(figure, panels.band_handles())
    return figure
