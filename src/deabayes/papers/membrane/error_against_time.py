"""Relative error over time, as in the membrane paper's Fig. 13."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, StudyContext, bands, curve_set
from deabayes.papers.timing import amplitude, since_step

SYSTEMS = ("membrane",)
TITLE = "Error against time (Fig. 13)"
CAPTION = (
    "Measured minus predicted displacement over the displacement's range from rest: the posterior "
    "median and the 5 to 95 % interval of the draws, against the time since the voltage came on."
)
SCOPE = "study"
ANALYSIS = "error_against_time"
FIGURE_TITLE = "Error against time"
FIRST = 50.0
FIGURE_CAPTION = (
    "Measured minus predicted displacement in per cent of its range from rest: posterior median "
    "and the interval of the draws. Steps: whole record and first 50 s; grey: the first 5 s, which "
    "the paper's error of the step leaves out."
)


def compute(context: StudyContext) -> Analysis:
    """Return one data set per displacement record."""
    records = [e for e in context.experiments if e.response_name == "displacement"]
    return Analysis(curves={each.name: error_curves(context, each) for each in records})


def error_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Bands (candidate, bound, time) of the error (y - f)/(max y - min y) in percent.

    The range of y includes zero, the value at rest.
    """
    y = experiment.response
    size = np.ptp(np.append(y, 0.0))
    return curve_set(
        context,
        {"time": (since_step(experiment), "s")},
        {"error": (bands(context, experiment, lambda c: 100.0 * (y - c) / size), "%")},
        experiment,
        protocol=experiment.protocol,
        amplitude_kV=amplitude(experiment.excitation) / 1e3,
    )


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return a sheet of steps and a sheet of sines, with one row per record."""
    by_name = sorted(analysis.curves.values(), key=lambda record: record.attrs["experiment"])
    steps: list[xr.Dataset] = []
    sines: list[xr.Dataset] = []
    for record in panels.by_size(by_name, "amplitude_kV"):
        (sines if record.attrs["protocol"] == "sine" else steps).append(record)
    return [_sheet(records) for records in (steps, sines) if records]


def _sheet(records: list[xr.Dataset]) -> Figure:
    sines = records[0].attrs["protocol"] == "sine"
    ratios = (1,) if sines else (3, 2)
    height = 1.25 * len(records) + 0.6
    figure, axes = panels.grid(
        len(records), len(ratios), height, width_ratios=ratios, sharey="row"
    )  # fmt: skip
    for row, record in zip(axes, records, strict=True):
        _panel(row[0], record, np.inf)
        row[0].set_ylabel("error (% of range)")
        row[0].set_title(panels.name_and_role(record), loc="left")
        if not sines:
            _panel(row[1], record, FIRST)
            row[1].set_title("first 50 s", loc="left", color=style.GREY)
    for ax in axes[-1]:
        ax.set_xlabel("time since the sine's start (s)" if sines else "time since the step (s)")
    panels.legend_below(figure, panels.handles(records[0], measured=False), 4)
    return figure


def _panel(ax: Axes, record: xr.Dataset, until: float) -> None:
    time = record["time"].values
    shown = (time >= 0.0) & (time <= until)
    panels.draw_candidates(ax, time[shown], record["error"].values[..., shown])
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    if record.attrs["protocol"] != "sine":
        ax.axvspan(0.0, paper.OVERSHOOT, color="#ececec", zorder=0, linewidth=0)
    ax.set_xlim(0.0, min(until, float(time[-1])))
