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
from deabayes.figures.results import StudyResults
from deabayes.papers.base import Analysis, StudyContext, band, interval, labels
from deabayes.papers.timing import STEPS, amplitude, since_step
from deabayes.quantities import ROLES

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


def compute(context: StudyContext) -> Analysis:
    """Return tables of shares and stages, and one data set per displacement step."""
    records = context.records("displacement", *STEPS)
    shares, stages = [], []
    for each in records:
        times = since_step(each)
        at = [t for t in TIMES if t < times[-1]]
        measured = {"shares": share_at(times, each.response, at),
                    "stages": gained(times, each.response)}  # fmt: skip
        for name, fitted in context.candidates.items():
            curves = context.responses(name, each)
            row = labels(name, fitted) | {"experiment": each.name}
            row |= {"voltage_kV": amplitude(each.excitation) / 1e3}
            predicted = share_at(times, curves, at).T
            shares += [
                row | {"time_s": t, "measured_percent": seen} | interval("predicted", "percent", of)
                for t, seen, of in zip(at, measured["shares"], predicted, strict=True)
            ]
            stages += [
                row | {"stage": stage, "measured_percent": seen}
                | interval("predicted", "percent", of)
                for stage, seen, of in zip(
                    STAGES, measured["stages"], gained(times, curves).T, strict=True)
            ]  # fmt: skip
    tables = {"displacement_shares": shares, "stages": stages}
    return Analysis(
        {name: pd.DataFrame(rows) for name, rows in tables.items() if rows},
        {each.name: step_curves(context, each) for each in records},
    )


def share_at(times: FloatArray, curves: FloatArray, at: list[float]) -> FloatArray:
    """Share (..., len(at)) of the last value reached at times since the step, in percent.

    Measured and predicted curves are interpolated linearly between the record's points. Before
    the first point they are constant.
    """
    rows = np.atleast_2d(curves)
    found = np.array([np.interp(at, times, row) for row in rows]) / rows[:, -1:]
    return np.asarray(100.0 * found.reshape(*curves.shape[:-1], len(at)))


def gained(times: FloatArray, curves: FloatArray) -> FloatArray:
    """Share (..., 3) of the last value gained in each stage, in percent; they add up to 100."""
    ends = [min(end, float(times[-1])) for end in STAGES.values()]
    reached = share_at(times, curves, ends)
    before = np.concatenate([np.zeros_like(reached[..., :1]), reached[..., :-1]], axis=-1)
    return np.asarray(reached - before)


def step_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Data set of measured and predicted displacement against the time since the step."""
    names = list(context.candidates)
    bands = np.array([band(context.responses(name, experiment)) for name in names])
    edges = [(a, b) for a, b in pairwise([0.0, *STAGES.values()])]
    return xr.Dataset(
        {
            "measured": ("time", experiment.response, {"units": "m"}),
            "predicted": (("candidate", "bound", "time"), bands, {"units": "m"}),
            "stage_end": ("stage", [end for _, end in edges], {"units": "s"}),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "stage": list(STAGES),
            "time": ("time", since_step(experiment), {"units": "s"}),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "voltage_kV": amplitude(experiment.excitation) / 1e3},
    )  # fmt: skip


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


def draw(results: StudyResults) -> list[Figure]:
    """Return sheets of up to three columns, one per step record, highest voltage first."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "voltage_kV")
    return [_sheet(list(group), found.tables["stages"]) for group in panels.batches(records, SHOWN)]


def _sheet(records: list[xr.Dataset], stages: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 3.9 + style.HEADER), layout="constrained")
    axes = figure.subplots(2, len(records), squeeze=False, height_ratios=(3, 2))
    for column, record in enumerate(records):
        role = str(record.attrs["role"])
        axes[0, column].set_title(
            f"{record.attrs['experiment']}, {ROLES.get(role, role)}", loc="left"
        )
        _response(axes[0, column], record)
        own = stages[stages["experiment"] == record.attrs["experiment"]]
        _shares(axes[1, column], own, record)
    axes[0, 0].set_ylabel("displacement (mm)")
    axes[1, 0].set_ylabel("share added (%)")
    panels.legend_below(figure, panels.handles(records[0]), 5)
    return figure


def _response(ax: Axes, record: xr.Dataset) -> None:
    time = record["time"].values
    shown = time > 0.0
    for k in range(record["candidate"].size):
        bands = 1e3 * record["predicted"].values[k][:, shown]
        panels.draw_candidate(ax, time[shown], bands, k)
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


def _shares(ax: Axes, stages: pd.DataFrame, record: xr.Dataset) -> None:
    order = [str(stage) for stage in record["stage"].values]
    candidates = [str(name) for name in record["candidate"].values]
    for k, name in enumerate(candidates):
        rows = stages[stages["candidate"] == name].set_index("stage").loc[order]
        x = np.arange(len(order)) + panels.spread(k, len(candidates), 0.18)
        middle = rows["predicted_percent"].to_numpy()
        reach = np.abs([middle - rows["predicted_q05"], rows["predicted_q95"] - middle])
        ax.errorbar(x, middle, yerr=reach, fmt=panels.marker(k), color=panels.colour(k),
                    markersize=2.5, elinewidth=0.8)  # fmt: skip
    measured = stages[stages["candidate"] == candidates[0]].set_index("stage").loc[order]
    ax.bar(np.arange(len(order)), measured["measured_percent"], width=0.7, zorder=0,
           facecolor="#e4e4e4", edgecolor=style.BLACK, linewidth=0.6)  # fmt: skip
    labels = [f"{number}: {stage}" for number, stage in zip(NUMBERS, order, strict=True)]
    ax.set_xticks(np.arange(len(order)), labels)
    ax.set_xlim(-0.5, len(order) - 0.5)
    ax.set_ylim(bottom=0.0)
