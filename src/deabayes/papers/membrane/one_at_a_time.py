"""Response as each parameter alone moves over its prior (Nguyen et al. 2021, Figs. 8 and 10)."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, CandidateResults
from deabayes.papers.membrane import prior_axes

SCOPE = "candidate"
ANALYSIS = "influence"
TITLE = "One parameter at a time"
CAPTION = (
    "The response as one parameter moves over quantiles of its prior while the others stay at "
    "their prior medians. Values that leave no response (pull-in, beyond the breakdown stretch) "
    "are named in the panel. What parameters do together is in the Sobol' indices."
)


def draw(results: CandidateResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one sheet per record, with one panel per parameter."""
    start = f"one_at_a_time_{results.name}_"
    return [_sheet(c) for name, c in analysis.curves.items() if name.startswith(start)]


def _sheet(curves: xr.Dataset) -> Figure:
    figure, axes = panels.sheet(curves.sizes["parameter"], 36 * style.MILLIMETRE)
    figure.suptitle(prior_axes.drive(curves))
    shown, x = prior_axes.horizontal(curves)
    values = curves["curve"].values[..., shown]
    unit, label = prior_axes.vertical(curves, values)
    colours = prior_axes.colours(curves)
    for k, ax in enumerate(axes):
        for row, colour in zip(values[k], colours, strict=True):
            ax.plot(x.values, row / unit.factor, color=colour, linewidth=0.9)
        panels.set_horizontal(ax, x)
        prior_axes.words(ax, curves.isel(parameter=k), np.isnan(values[k, :, 0]))
    prior_axes.share(axes, label, values / unit.factor)
    panels.legend_below(figure, prior_axes.handles(curves), columns=curves.sizes["quantile"])
    return figure
