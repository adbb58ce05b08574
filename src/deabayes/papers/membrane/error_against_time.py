"""Relative error over time, as in the membrane paper's Fig. 13."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers.base import Analysis, StudyContext, band
from deabayes.papers.timing import amplitude, since_step
from deabayes.quantities import ROLES

SYSTEMS = ("membrane",)
TITLE = "Error against time (Fig. 13)"
CAPTION = (
    "Measured minus predicted displacement over the displacement's range from rest: the posterior "
    "median and the 5 to 95 % interval of the draws, against the time since the voltage came on."
)


def compute(context: StudyContext) -> Analysis:
    """Return one data set per displacement record."""
    records = [e for e in context.experiments if e.response_name == "displacement"]
    return Analysis(curves={each.name: error_curves(context, each) for each in records})


def error_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Bands (candidate, bound, time) of the error (y - f)/(max y - min y) in percent.

    The range of y includes zero, the value at rest.
    """
    size = np.ptp(np.append(experiment.response, 0.0))
    names = list(context.candidates)
    errors = [
        band(100.0 * (experiment.response - context.responses(name, experiment)) / size)
        for name in names
    ]
    return xr.Dataset(
        {"error": (("candidate", "bound", "time"), np.array(errors), {"units": "%"})},
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "time": ("time", since_step(experiment), {"units": "s"}),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "protocol": experiment.protocol,
               "amplitude_kV": amplitude(experiment.excitation) / 1e3},
    )  # fmt: skip


SCOPE = "study"
ANALYSIS = "error_against_time"
FIGURE_TITLE = "Error against time"
FIRST = 50.0
OVERSHOOT = 5.0
FIGURE_CAPTION = (
    "Measured minus predicted displacement in per cent of its range from rest: posterior median "
    "and the interval of the draws. Steps: whole record and first 50 s; grey: the first 5 s, which "
    "the paper's error of the step leaves out."
)


def draw(results: StudyResults) -> list[Figure]:
    """Return a sheet of steps and a sheet of sines, with one row per record."""
    found = results.analysis(ANALYSIS)
    if found is None:
        return []
    records = sorted(found.curves.values(), key=_name)
    records = panels.by_size(records, "amplitude_kV")
    steps = [each for each in records if each.attrs["protocol"] != "sine"]
    sines = [each for each in records if each.attrs["protocol"] == "sine"]
    sheets = [_sheet(steps, first=True)] if steps else []
    return sheets + ([_sheet(sines, first=False)] if sines else [])


def _sheet(records: Sequence[xr.Dataset], first: bool) -> Figure:
    height = 1.25 * len(records) + 0.6 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    ratios = (3, 2) if first else (1,)
    axes = figure.subplots(
        len(records), len(ratios), squeeze=False, width_ratios=ratios, sharey="row"
    )
    for row, record in zip(axes, records, strict=True):
        _panel(row[0], record, np.inf)
        row[0].set_ylabel("error (% of range)")
        row[0].set_title(_title(record), loc="left")
        if first:
            _panel(row[1], record, FIRST)
            row[1].set_title("first 50 s", loc="left", color=style.GREY)
    for ax in axes[-1]:
        ax.set_xlabel("time since the step (s)" if first else "time since the sine's start (s)")
    panels.legend_below(figure, panels.handles(records[0], measured=False), 4)
    return figure


def _panel(ax: Axes, record: xr.Dataset, until: float) -> None:
    time = record["time"].values
    shown = (time >= 0.0) & (time <= until)
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, time[shown], record["error"].values[k][:, shown], k)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    if record.attrs["protocol"] != "sine":
        ax.axvspan(0.0, OVERSHOOT, color="#ececec", zorder=0, linewidth=0)
    ax.set_xlim(0.0, min(until, float(time[-1])))


def _name(record: xr.Dataset) -> str:
    return str(record.attrs["experiment"])


def _title(record: xr.Dataset) -> str:
    role = str(record.attrs["role"])
    return f"{_name(record)}, {ROLES.get(role, role)}"
