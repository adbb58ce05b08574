"""A sine's stable cycle and its error against the phase, as in the paper's Figs 8 and 10."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deabayes.analyses import structure_paper as paper
from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import Cycles, IntArray
from deabayes.analyses.summaries import band, beside, interval, labels
from deabayes.experiment import Experiment, FloatArray

if TYPE_CHECKING:
    import xarray as xr

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Error against phase (Figs 8 and 10)"
PERCENT = 100.0
FEWEST = 4
CAPTION = (
    "Measured minus predicted displacement over the last whole cycle of the sines the paper shows, "
    "in per cent of the record's range, at the phase of the voltage since its lowest value. "
    "Largest: the largest magnitude over the cycle, of the posterior median curve, with the 5 to "
    "95 % interval of the draws' own; mean: of the error over the cycle, an offset that creep or "
    "its lack leaves. Both voltages side by side; the paper shows these as curves only."
)


def compute(context: StudyContext) -> Analysis:
    """One data set per sine of the paper's figures; the largest error of each."""
    import pandas as pd

    rows, curves = [], {}
    for each in context.records("displacement", "sine"):
        frequency, points = Cycles.of(each).frequency, stable_points(each)
        if points.size < FEWEST or not any(paper.near(frequency, f) for f in paper.SHOWN):
            continue
        curves[each.name] = phase_curves(context, each, points)
        place = {"frequency_Hz": round(frequency, 3), "voltage_kV": paper.kilovolts(each)}
        for name, fitted in context.candidates.items():
            error = relative(each, context.responses(name, each))[:, points]
            rows.append(labels(name, fitted) | place | {"role": each.role} | of_cycle(error))
    return Analysis({"phase_errors": pd.DataFrame(beside(rows, "kV"))} if rows else {}, curves)


def stable_points(experiment: Experiment) -> IntArray:
    """Indices of the points of the last whole cycle, by phase of the voltage."""
    cycles, times = Cycles.of(experiment), experiment.coordinate
    if cycles.starts.size == 0 or Cycles.driven(experiment.excitation).starts.size == 0:
        return np.array([], dtype=np.int64)
    start = cycles.starts[-1]
    inside = np.flatnonzero((times >= start) & (times < start + cycles.period))
    return inside[np.argsort(phase(experiment)[inside], kind="stable")]


def phase(experiment: Experiment) -> FloatArray:
    """Share of a period since the voltage's magnitude was lowest, 0 to 1, at each point (N,)."""
    driven = Cycles.driven(experiment.excitation)
    since = experiment.coordinate[:, None] - driven.starts
    last = np.clip(np.sum(since >= 0.0, axis=1) - 1, 0, None)
    return (np.take_along_axis(since, last[:, None], 1)[:, 0] / driven.period) % 1.0


def relative(experiment: Experiment, curves: FloatArray) -> FloatArray:
    """(y - f)/(max y - min y) in percent (S, N)."""
    return PERCENT * (experiment.response - curves) / experiment.response_range


def of_cycle(error: FloatArray) -> dict[str, float]:
    """Largest magnitude and mean of errors (S, P) over a cycle."""
    middle = np.median(error, axis=0)
    found = interval("largest", "percent", np.abs(error).max(axis=1), np.abs(middle).max())
    return found | interval("mean", "percent", error.mean(axis=1), middle.mean())


def phase_curves(context: StudyContext, experiment: Experiment, points: IntArray) -> xr.Dataset:
    """Measured and predicted displacement and error over the phase: bands."""
    import xarray as xr

    names = list(context.candidates)
    moved = [context.responses(name, experiment) for name in names]
    errors = np.array([band(relative(experiment, m)[:, points]) for m in moved])
    along = ("candidate", "bound", "phase")
    return xr.Dataset(
        {
            "measured": ("phase", experiment.response[points], {"units": "m"}),
            "predicted": (along, np.array([band(m[:, points]) for m in moved]), {"units": "m"}),
            "error": (along, errors, {"units": "%"}),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "phase": ("phase", phase(experiment)[points], {"units": "1"}),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "frequency_Hz": Cycles.of(experiment).frequency,
               "amplitude_kV": paper.kilovolts(experiment)},
    )  # fmt: skip
