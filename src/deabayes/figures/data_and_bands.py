"""Every record with the posterior median and the three 90 % bands."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import bands, panels
from deabayes.figures.record import Record, side_by_side
from deabayes.figures.results import CandidateResults

SCOPE = "candidate"
TITLE = "Data and predictions"
CAPTION = (
    "Observed points, the posterior median and three separate 90 % bands. The blue band says how "
    "well the parameters are known; only the grey one, up to the grey line, says where new data "
    "would fall: with little white noise the band with discrepancy fills all of it. What follows a "
    "single step is drawn against the logarithm of the time since the step, without the points "
    "before it. Frequencies are logarithmic too, gains on both axes. Load–unload records are loops."
)


def draw(results: CandidateResults, role: str = "", observed: str = "observed") -> list[Figure]:
    """Return one sheet per nine records.

    A non-empty `role` replaces the records' own roles in their titles. `observed` is the legend's
    label of the points.
    """

    def panel(ax: Axes, record: Record) -> None:
        x = record.horizontal()
        bands.draw(ax, record, x)
        panels.draw_observed(ax, x.values, record.response("observed"))
        panels.draw_median(ax, record, x, role)

    records = side_by_side(results.predictions.values())
    return panels.record_sheets(records, 44, panel, bands.handles(observed))
