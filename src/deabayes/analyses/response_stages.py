"""Stages of the membrane's step response: instantaneous, fast, slow."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import STEPS, amplitude, since_step
from deabayes.analyses.summaries import band, interval, labels
from deabayes.experiment import Experiment, FloatArray

if TYPE_CHECKING:
    import xarray as xr

SYSTEMS = ("membrane",)
TITLE = "Stages of the step response"
STAGES = {"instantaneous": 1.0, "fast": 30.0, "slow": np.inf}
"""Stage -> when it ends [s] after the step; the boundaries are ours."""
TIMES = (1.0, 5.0, 30.0, 100.0, 300.0)
CAPTION = (
    "Share of the record's last displacement reached at stated times, and gained in each stage: "
    "instantaneous (to 1 s: dashpot α and the charging), fast (1 to 30 s), slow (from 30 s on). "
    "Medians with 5 to 95 % intervals of the draws; the measured shares are read off the same "
    "points. The boundaries are ours; the paper gives none."
)


def compute(context: StudyContext) -> Analysis:
    """Tables of shares and stages; one data set per displacement step."""
    import pandas as pd

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

    Straight between the record's points, for measured and predicted curves alike; held at the
    first point before it.
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
    """Displacement against the time since the step, measured and predicted."""
    import xarray as xr

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
