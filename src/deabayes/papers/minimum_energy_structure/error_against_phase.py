"""Last cycle of a sine and its error against the phase, as in the paper's Figs 8 and 10."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, band, beside, interval, labels
from deabayes.papers.timing import Cycles, IntArray
from deabayes.quantities import ROLES, short

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
    """Return one data set per sine of the paper's figures, and a table of their errors."""
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
    """Indices of the points of the last whole cycle, sorted by phase of the voltage."""
    cycles, times = Cycles.of(experiment), experiment.coordinate
    if cycles.starts.size == 0 or Cycles.driven(experiment.excitation).starts.size == 0:
        return np.array([], dtype=np.int64)
    start = cycles.starts[-1]
    inside = np.flatnonzero((times >= start) & (times < start + cycles.period))
    return inside[np.argsort(phase(experiment)[inside], kind="stable")]


def phase(experiment: Experiment) -> FloatArray:
    """Phase (N,) of each point, 0 to 1, from the lowest magnitude of the voltage."""
    driven = Cycles.driven(experiment.excitation)
    since = experiment.coordinate[:, None] - driven.starts
    last = np.clip(np.sum(since >= 0.0, axis=1) - 1, 0, None)
    return (np.take_along_axis(since, last[:, None], 1)[:, 0] / driven.period) % 1.0


def relative(experiment: Experiment, curves: FloatArray) -> FloatArray:
    """Relative error (y - f)/(max y - min y) in percent (S, N)."""
    return PERCENT * (experiment.response - curves) / experiment.response_range


def of_cycle(error: FloatArray) -> dict[str, float]:
    """Largest magnitude and mean of errors (S, P) over a cycle."""
    middle = np.median(error, axis=0)
    found = interval("largest", "percent", np.abs(error).max(axis=1), np.abs(middle).max())
    return found | interval("mean", "percent", error.mean(axis=1), middle.mean())


def phase_curves(context: StudyContext, experiment: Experiment, points: IntArray) -> xr.Dataset:
    """Data set of measured displacement, and bands of predicted displacement and error."""
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


SCOPE = "study"
ANALYSIS = "error_against_phase"
FIGURE_TITLE = "Error against phase"
FIGURE_CAPTION = (
    "Last whole cycle of each sine against the phase since the voltage was lowest: displacement "
    "above, measured minus predicted in per cent of the record's range below; medians and "
    "intervals of the draws."
)


def draw(results: StudyResults) -> list[Figure]:
    """Return one sheet per voltage, with one column per frequency."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    records = panels.by_size(list(found.curves.values()), "frequency_Hz")[::-1]
    voltages = sorted({round(float(r.attrs["amplitude_kV"]), 1) for r in records}, reverse=True)
    return [
        _sheet([r for r in records if round(float(r.attrs["amplitude_kV"]), 1) == voltage])
        for voltage in voltages
    ]


def _sheet(records: list[xr.Dataset]) -> Figure:
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 3.9 + style.HEADER), layout="constrained")
    axes = figure.subplots(2, len(records), squeeze=False, sharex=True, sharey="row")
    for (above, below), record in zip(axes.T, records, strict=True):
        _moved(above, record)
        _error(below, record)
        below.set_xlabel("phase of the voltage (°)")
        below.set_xticks(range(0, 361, 90))
    axes[0, 0].set_ylabel("displacement (mm)")
    axes[1, 0].set_ylabel("error (% of range)")
    panels.legend_below(figure, panels.handles(records[0]), 4)
    return figure


def _moved(ax: Axes, record: xr.Dataset) -> None:
    phase = 360.0 * record["phase"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, phase, 1e3 * record["predicted"].values[k], k)
    ax.plot(phase, 1e3 * record["measured"].values, "o", color=style.BLACK, markersize=2.5)
    hertz, volts = (short(float(record.attrs[n]), 2) for n in ("frequency_Hz", "amplitude_kV"))
    ax.set_title(f"{volts} kV, {hertz} Hz, {ROLES[str(record.attrs['role'])]}", loc="left")


def _error(ax: Axes, record: xr.Dataset) -> None:
    phase = 360.0 * record["phase"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, phase, record["error"].values[k], k)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    ax.set_xlim(0.0, 360.0)
