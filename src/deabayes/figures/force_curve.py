"""Force at rest against displacement at constant voltages, and its error: the paper's Fig. 7."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES, short

SCOPE = "study"
ANALYSIS = "force_curve"
TITLE = "Force against displacement"
LIMIT = 6.0
CAPTION = (
    "Left: force on a slider held at rest at constant voltages, measured and as the recommended "
    "candidate predicts it (median and interval of the draws); grey: the paper's Table 3 in this "
    "specimen. Right: measured minus predicted in per cent of each record's range, every "
    "candidate; dotted: the 6 % the paper's errors stay below. Filled points were fitted."
)


def draw(results: StudyResults) -> list[Figure]:
    """Forces of all voltages in one panel, errors in one each."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "voltage_kV")
    names = [str(name) for name in records[0]["candidate"].values]
    best = results.recommended.name
    shown = names.index(best) if best in names else 0
    height = 0.95 * len(records) + 0.7 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, max(height, 3.0)), layout="constrained")
    axes = figure.subplot_mosaic(
        [["forces", f"error {k}"] for k in range(len(records))], width_ratios=(5, 4)
    )
    for record in records:
        _forces(axes["forces"], record, shown)
    axes["forces"].set_xlabel("displacement (mm)")
    axes["forces"].set_ylabel("force on the slider, outwards (mN)")
    axes["forces"].set_title(f"predicted by {names[shown]}", loc="left", color=style.GREY)
    for k, record in enumerate(records):
        _error(axes[f"error {k}"], record)
    for k in range(len(records) - 1):
        axes[f"error {k}"].tick_params(labelbottom=False)
    axes[f"error {len(records) - 1}"].set_xlabel("displacement (mm)")
    paper = Line2D([], [], color=style.GREY, linestyle=(0, (1, 1)), label="paper's Table 3")
    panels.legend_below(figure, [*panels.handles(records[0]), paper], 4)
    return [figure]


def _forces(ax: Axes, record: xr.Dataset, shown: int) -> None:
    place = 1e3 * record["displacement"].values
    ax.plot(place, 1e3 * record["paper"].values, color=style.GREY, linestyle=(0, (1, 1)),
            linewidth=0.9)  # fmt: skip
    panels.draw_candidate(ax, place, 1e3 * record["predicted"].values[shown], shown)
    fitted = record.attrs["role"] == "calibrate"
    measured = 1e3 * record["measured"].values
    ax.plot(place, measured, "o", color=style.BLACK, markersize=1.8, markeredgewidth=0.4,
            markerfacecolor=style.BLACK if fitted else "white")  # fmt: skip
    ax.annotate(f"{short(record.attrs['voltage_kV'])} kV", (place[-1], measured[-1]), (4, 0),
                textcoords="offset points", va="center", fontsize=6.0)  # fmt: skip


def _error(ax: Axes, record: xr.Dataset) -> None:
    place = 1e3 * record["displacement"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, place, record["error"].values[k], k)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    for limit in (-LIMIT, LIMIT):
        ax.axhline(limit, color=style.GREY, linestyle=":", linewidth=0.8)
    ax.set_ylabel("error\n(% of range)")
    role = ROLES[str(record.attrs["role"])]
    ax.set_title(f"{short(record.attrs['voltage_kV'])} kV, {role}", loc="left")
