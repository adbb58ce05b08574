"""Last cycle of a sine and its error against the phase, as in the paper's Figs 8 and 10."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, bands, beside, curve_set, error_interval
from deabayes.papers.timing import Cycles, IntArray, near
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
SCOPE = "study"
ANALYSIS = "error_against_phase"
FIGURE_TITLE = "Error against phase"
FIGURE_CAPTION = (
    "Last whole cycle of each sine against the phase since the voltage was lowest: displacement "
    "above, measured minus predicted in per cent of the record's range below; medians and "
    "intervals of the draws."
)


def compute(context: StudyContext) -> Analysis:
    """Return one data set per sine of the paper's figures, and a table of their errors."""
    records = {
        record.name: points
        for record in context.records("displacement", "sine")
        if (points := stable_points(record)).size >= FEWEST
        and any(near(Cycles.of(record).frequency, shown) for shown in paper.SHOWN)
    }
    sines = [record for record in context.experiments if record.name in records]
    rows = [
        first
        | {"frequency_Hz": round(Cycles.of(record).frequency, 3)}
        | {"voltage_kV": paper.kilovolts(record), "role": record.role}
        | of_cycle(relative(record, curves)[:, records[record.name]])
        for first, record, curves in context.predicted(sines)
    ]
    curves = {r.name: phase_curves(context, r, records[r.name]) for r in sines}
    return Analysis.of_rows({"phase_errors": beside(rows)}, curves)


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
    return {
        **error_interval("largest", error, lambda e: np.abs(e).max(axis=-1)),
        **error_interval("mean", error, lambda e: e.mean(axis=-1)),
    }


def phase_curves(context: StudyContext, experiment: Experiment, points: IntArray) -> xr.Dataset:
    """Data set of measured displacement, and bands of predicted displacement and error."""

    def error(curves: FloatArray) -> FloatArray:
        return relative(experiment, curves)[:, points]

    return curve_set(
        context,
        {"phase": (phase(experiment)[points], "1")},
        {
            "measured": (experiment.response[points], "m"),
            "predicted": (bands(context, experiment, lambda c: c[:, points]), "m"),
            "error": (bands(context, experiment, error), "%"),
        },
        experiment,
        frequency_Hz=Cycles.of(experiment).frequency,
        amplitude_kV=paper.kilovolts(experiment),
    )


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one sheet per voltage, with one column per frequency."""
    records = panels.by_size(analysis.curves.values(), "frequency_Hz")[::-1]
    by_voltage: dict[float, list[xr.Dataset]] = {}
    for record in records:
        by_voltage.setdefault(round(float(record.attrs["amplitude_kV"]), 1), []).append(record)
    return [_sheet(by_voltage[voltage]) for voltage in sorted(by_voltage, reverse=True)]


def _sheet(records: list[xr.Dataset]) -> Figure:
    figure, axes = panels.grid(2, len(records), 3.9, sharex=True, sharey="row")
    for (above, below), record in zip(axes.T, records, strict=True):
        _displacement(above, record)
        _error(below, record)
        below.set_xlabel("phase of the voltage (°)")
        below.set_xticks(range(0, 361, 90))
    axes[0, 0].set_ylabel("displacement (mm)")
    axes[1, 0].set_ylabel("error (% of range)")
    panels.legend_below(figure, panels.handles(records[0]), 4)
    return figure


def _displacement(ax: Axes, record: xr.Dataset) -> None:
    degrees = 360.0 * record["phase"].values
    panels.draw_candidates(ax, degrees, 1e3 * record["predicted"].values)
    ax.plot(degrees, 1e3 * record["measured"].values, "o", color=style.BLACK, markersize=2.5)
    hertz, volts = (short(float(record.attrs[n]), 2) for n in ("frequency_Hz", "amplitude_kV"))
    ax.set_title(f"{volts} kV, {hertz} Hz, {ROLES[str(record.attrs['role'])]}", loc="left")


def _error(ax: Axes, record: xr.Dataset) -> None:
    panels.draw_candidates(ax, 360.0 * record["phase"].values, record["error"].values)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    ax.set_xlim(0.0, 360.0)
