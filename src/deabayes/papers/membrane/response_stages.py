"""Stages of the membrane's step response: instantaneous, fast, slow."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers.base import Analysis, StudyContext, bands, curve_set, interval, labels
from deabayes.papers.timing import STEPS, amplitude, since_step

SYSTEMS = ("membrane",)
TITLE = "Stages of the step response"
STAGES = {"instantaneous": 1.0, "fast": 30.0, "slow": np.inf}
"""End of each stage [s] after the step; the boundaries are ours."""
TIMES = (1.0, 5.0, 30.0, 100.0, 300.0)
CAPTION = (
    "Share of the record's last displacement reached at stated times, and gained in each stage: "
    "instantaneous (to 1 s: dashpot α and the charging), fast (1 to 30 s), slow (from 30 s on). "
    "Medians with 5 to 95 % intervals of the draws; the measured shares are read off the same "
    "points. The boundaries are ours; the paper gives none."
)
SCOPE = "study"
ANALYSIS = "response_stages"
FIGURE_TITLE = "Stages of the step response"
FIGURE_CAPTION = (
    "Above: displacement after the step, measured and predicted, on a logarithmic time axis; "
    "dotted lines part the stages. Below: the share of the last displacement that each stage adds, "
    "measured (bars) and predicted."
)
SHOWN = 3
NUMBERS = ("I", "II", "III")


def compute(context: StudyContext) -> Analysis:
    """Return tables of shares and stages, and one data set per displacement step."""
    records = context.records("displacement", *STEPS)
    shares, stages = [], []
    for record in records:
        times, y = since_step(record), record.response
        at = [t for t in TIMES if t < times[-1]]
        first = {"experiment": record.name, "voltage_kV": amplitude(record.excitation) / 1e3}
        for name, fitted in context.candidates.items():
            row, curves = labels(name, fitted) | first, context.responses(name, record)
            reached = zip(at, share_at(times, y, at), share_at(times, curves, at).T, strict=True)
            added = zip(STAGES, gained(times, y), gained(times, curves).T, strict=True)
            shares += [row | {"time_s": t} | _compared(*of_time) for t, *of_time in reached]
            stages += [row | {"stage": s} | _compared(*of_stage) for s, *of_stage in added]
    return Analysis.of_rows(
        {"displacement_shares": shares, "stages": stages},
        {record.name: step_curves(context, record) for record in records},
    )


def _compared(measured: float, predicted: FloatArray) -> dict[str, float]:
    return {"measured_percent": measured, **interval("predicted", "percent", predicted)}


def share_at(times: FloatArray, curves: FloatArray, at: list[float]) -> FloatArray:
    """Share (..., len(at)) of the last value reached at times since the step, in percent.

    Measured and predicted curves are interpolated linearly between the record's points. Before
    the first point they are constant.
    """
    rows = np.atleast_2d(curves)
    shares = np.array([np.interp(at, times, row) for row in rows]) / rows[:, -1:]
    return np.asarray(100.0 * shares.reshape(*curves.shape[:-1], len(at)))


def gained(times: FloatArray, curves: FloatArray) -> FloatArray:
    """Share (..., 3) of the last value gained in each stage, in percent; they add up to 100."""
    ends = [min(end, float(times[-1])) for end in STAGES.values()]
    reached = share_at(times, curves, ends)
    return np.diff(reached, prepend=0.0, axis=-1)


def step_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Data set of measured and predicted displacement against the time since the step."""
    curves = curve_set(
        context,
        {"time": (since_step(experiment), "s")},
        {"measured": (experiment.response, "m"), "predicted": (bands(context, experiment), "m")},
        experiment,
        voltage_kV=amplitude(experiment.excitation) / 1e3,
    )
    ends = ("stage", list(STAGES.values()), {"units": "s"})
    return curves.assign_coords(stage=list(STAGES)).assign(stage_end=ends)


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return sheets of up to three columns, one per step record, highest voltage first."""
    records = panels.by_size(analysis.curves.values(), "voltage_kV")
    groups = panels.batches(records, SHOWN)
    return [_sheet(list(group), analysis.tables["stages"]) for group in groups]


def _sheet(records: list[xr.Dataset], stages: pd.DataFrame) -> Figure:
    figure, axes = panels.grid(2, len(records), 3.9, height_ratios=(3, 2))
    for (above, below), record in zip(axes.T, records, strict=True):
        above.set_title(panels.name_and_role(record), loc="left")
        _response(above, record)
        _shares(below, stages[stages["experiment"] == record.attrs["experiment"]])
    axes[0, 0].set_ylabel("displacement (mm)")
    axes[1, 0].set_ylabel("share added (%)")
    panels.legend_below(figure, panels.handles(records[0]), 5)
    return figure


def _response(ax: Axes, record: xr.Dataset) -> None:
    time = record["time"].values
    shown = time > 0.0
    panels.draw_candidates(ax, time[shown], 1e3 * record["predicted"].values[..., shown])
    panels.draw_observed(ax, time[shown], 1e3 * record["measured"].values[shown], 1.6)
    ends = record["stage_end"].values
    edges = [time[shown][0], *np.minimum(ends, time[-1])]
    for number, (start, end) in zip(NUMBERS, pairwise(edges), strict=True):
        if end < time[-1]:
            ax.axvline(end, color=style.GREY, linestyle=":", linewidth=0.8)
        ax.text(np.sqrt(start * end), 0.03, number, transform=ax.get_xaxis_transform(),
                ha="center", color=style.GREY)  # fmt: skip
    panels.logarithmic(ax, time[shown])
    ax.set_xlabel("time since the step (s)")
    ax.set_ylim(bottom=0.0)


def _shares(ax: Axes, stages: pd.DataFrame) -> None:
    place, groups = np.arange(len(STAGES)), stages.groupby("candidate", sort=False)
    for k, (_, rows) in enumerate(groups):
        middle, low, high = (rows[f"predicted_{end}"] for end in ("percent", "q05", "q95"))
        ax.errorbar(place + panels.spread(k, len(groups), 0.18), middle,
                    yerr=np.abs([middle - low, high - middle]), fmt=panels.marker(k),
                    color=panels.colour(k), markersize=2.5, elinewidth=0.8)  # fmt: skip
    measured = stages[stages["candidate"] == stages["candidate"].iloc[0]]["measured_percent"]
    ax.bar(place, measured, width=0.7, zorder=0, facecolor="#e4e4e4", edgecolor=style.BLACK,
           linewidth=0.6)  # fmt: skip
    ax.set_xticks(place, [f"{number}: {s}" for number, s in zip(NUMBERS, STAGES, strict=True)])
    ax.set_xlim(-0.5, len(STAGES) - 0.5)
    ax.set_ylim(bottom=0.0)
