"""Response as each parameter alone moves over its prior (Nguyen et al. 2021, Figs. 8 and 10)."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.papers.membrane import prior_axes as moved
from deabayes.papers.membrane.prior_axes import drive, head, horizontal, vertical

SCOPE = "candidate"
ANALYSIS = "influence"
TITLE = "One parameter at a time"
CAPTION = (
    "The response as one parameter moves over quantiles of its prior while the others stay at "
    "their prior medians. Values that leave no response (pull-in, beyond the breakdown stretch) "
    "are named in the panel. What parameters do together is in the Sobol' indices."
)


def draw(results: CandidateResults) -> list[Figure]:
    """Return one sheet per record, with one panel per parameter."""
    found = results.study.analysis(ANALYSIS)
    if found is None:
        return []
    start = f"one_at_a_time_{results.name}_"
    return [_sheet(c) for name, c in found.curves.items() if name.startswith(start)]


def _sheet(curves: xr.Dataset) -> Figure:
    figure, axes = panels.sheet(curves.sizes["parameter"], 36 * style.MILLIMETRE)
    head(figure, drive(curves))
    shown, x = horizontal(curves)
    values = curves["curve"].values[..., shown]
    unit, label = vertical(curves, values)
    shared = moved.limits(values / unit.factor)
    for k, ax in enumerate(axes):
        for row, colour in zip(values[k], moved.colours(len(values[k])), strict=True):
            ax.plot(x.values, row / unit.factor, color=colour, linewidth=0.9)
        ax.set_ylim(shared)
        panels.set_horizontal(ax, x)
        moved.words(ax, curves.isel(parameter=k), np.isnan(values[k, :, 0]))
    moved.label_outer(axes, label)
    panels.legend_below(figure, moved.handles(curves), columns=curves.sizes["quantile"])
    return figure
