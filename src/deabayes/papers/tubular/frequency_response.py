"""Gain and phase against frequency under all loads: Fig. 10 of the tubular paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.record import Record, side_by_side
from deabayes.figures.results import CandidateResults
from deabayes.quantities import short

SCOPE = "candidate"
SYSTEMS = ("tubular",)
TITLE = "Frequency responses"
CAPTION = (
    "Gain and phase of the strain's term of the driving frequency, against the sine of the "
    "amplifier's voltage, as prepared (a known delay of the sensor is taken out): measured points, "
    "the posterior median and the 90 % predictive band (parameters, discrepancy and noise)."
)

BAND = 0.22
"""Opacity of bands."""


def draw(results: CandidateResults) -> list[Figure]:
    """Return one figure with gain above phase and one colour per record."""
    records = side_by_side(results.predictions.values())
    responses = [[r for r in records if r.response_name == kind] for kind in ("gain", "phase")]
    shown = [same for same in responses if same]
    if not shown:
        return []
    figure, axes = panels.grid(len(shown), 1, 2.1 * len(shown) + 0.5, 0.75, sharex=True)
    first = {_motion(record): record for same in shown[::-1] for record in same}
    motions = sorted(first, key=list(map(_motion, records)).index)
    for ax, same in zip(axes[:, 0], shown, strict=True):
        _draw_all(ax, same, motions)
    axes[-1, 0].set_xlabel("frequency (Hz)")
    panels.legend_below(figure, _handles(results, [first[motion] for motion in motions]), 3)
    return [figure]


def _motion(record: Record) -> str:
    """Name that the gain record and the phase record of a motion share."""
    return record.name.removesuffix("_phase")


def _draw_all(ax: Axes, records: Sequence[Record], motions: Sequence[str]) -> None:
    """Draw every record of one response in one panel."""
    for record in records:
        index = motions.index(_motion(record))
        frequency = record.against_coordinate().values
        colour = style.SERIES[index % len(style.SERIES)]
        ax.fill_between(
            frequency, *record.band("predictive"), color=colour, alpha=BAND, linewidth=0
        )
        ax.plot(frequency, record.response("median"), color=colour, linewidth=1.0)
        ax.plot(frequency, record.response("observed"), color=colour, linestyle="none",
                marker=style.MARKERS[index % len(style.MARKERS)], markersize=1.8,
                markeredgewidth=0, alpha=0.8)  # fmt: skip
    if any(record.extrapolation for record in records):
        ax.set_title(panels.EXTRAPOLATION, loc="right", fontsize=panels.SMALL,
                     color=style.VERMILLION, weight="bold")  # fmt: skip
    if records[0].spans_decades:
        ax.set_yscale("log")
    every = [record.against_coordinate().values for record in records]
    panels.logarithmic(ax, np.concatenate(every))
    ax.set_ylabel(records[0].label)


def _handles(results: CandidateResults, records: Sequence[Record]) -> list[Line2D | Patch]:
    """Legend entries: the load of each record, or its name if no load is stated, and its role."""
    entries: list[Line2D | Patch] = []
    for k, record in enumerate(records):
        load = results.study.experiments[record.name].metadata.get("load_g")
        name = record.name if load is None else f"{short(float(load))} g"
        entries.append(
            panels.key(f"{name}, {record.role}", style.SERIES[k % len(style.SERIES)],
                       marker=style.MARKERS[k % len(style.MARKERS)], markersize=3,
                       linestyle="-", linewidth=1.0)
        )  # fmt: skip
    colour = style.SERIES[0] if len(records) == 1 else style.GREY
    label = "90 % predictive band" + ("" if len(records) == 1 else ", in its record's colour")
    return [*entries, Patch(facecolor=colour, alpha=BAND, linewidth=0, label=label)]
