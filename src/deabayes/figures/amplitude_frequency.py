"""Peak-to-peak displacement against frequency."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.quantities import ROLES, short

SCOPE = "study"
ANALYSIS = "amplitude_frequency"
TITLE = "Amplitude against frequency"
CAPTION = (
    "Peak-to-peak displacement of the last cycles against the voltage's frequency: measured, and "
    "as each candidate predicts it (median, interval of the draws)."
)


def draw(results: StudyResults) -> list[Figure]:
    """One panel."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    bands, table = found.curves["bands"], found.tables["amplitude_frequency"]
    width = 0.7 * style.DOUBLE_COLUMN
    figure = Figure(figsize=(width, 2.6 + style.HEADER), layout="constrained")
    ax = figure.subplots()
    frequency = bands["frequency"].values
    for k in range(bands["candidate"].size):
        panels.draw_candidate(ax, frequency, 1e3 * bands["predicted"].values[k], k)
    seen = table.drop_duplicates("experiment")
    entries: list[Line2D | Patch] = []
    for role, fill in (("calibrate", style.BLACK), ("validate", "white")):
        rows = seen[seen["role"] == role]
        if len(rows):
            entries += ax.plot(rows["frequency_Hz"], rows["measured_mm"], "o", color=style.BLACK,
                               markerfacecolor=fill, markersize=4, zorder=5,
                               label=f"measured, {ROLES[role]}")  # fmt: skip
    panels.logarithmic(ax, frequency)
    ax.set_xlabel("frequency of the voltage (Hz)")
    ax.set_ylabel("peak-to-peak displacement (mm)")
    ax.set_title(f"sine of {short(bands.attrs['amplitude_kV'])} kV", loc="left")
    panels.legend_below(figure, [*entries, *panels.handles(bands, measured=False)], 3)
    return [figure]
