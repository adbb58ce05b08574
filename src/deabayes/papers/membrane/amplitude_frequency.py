"""Peak-to-peak displacement of the settled response against the voltage's frequency."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers.amplitude import PHASES, settled_bands
from deabayes.papers.base import Analysis, StudyContext, curve_set, interval, labels
from deabayes.papers.timing import Cycles, amplitude, near, resampled
from deabayes.quantities import ROLES, short

SYSTEMS = ("membrane",)
TITLE = "Amplitude against frequency"
LAST, FREQUENCIES, DRAWS = 2, 15, 200
"""Cycles that are averaged; frequencies and draws of the predicted curve."""
CAPTION = (
    "Peak-to-peak displacement, mean of the last two cycles, under a sine of the records' "
    "amplitude; frequency is the voltage's. Medians with 5 to 95 % intervals of the draws (the "
    "model's own: neither discrepancy nor noise is in them)."
)
SCOPE = "study"
ANALYSIS = "amplitude_frequency"
FIGURE_TITLE = "Amplitude against frequency"
FIGURE_CAPTION = (
    "Peak-to-peak displacement of the last cycles against the voltage's frequency: measured, and "
    "as each candidate predicts it (median, interval of the draws)."
)


def compute(context: StudyContext) -> Analysis:
    """Return a table of the records, and bands over a grid that spans their frequencies."""
    records = [
        r for r in context.records("displacement", "sine") if Cycles.of(r).starts.size >= LAST
    ]
    if not records:
        return Analysis()
    volts = float(np.median([amplitude(record.excitation) for record in records]))
    records = [record for record in records if near(amplitude(record.excitation), volts)]
    rows = []
    for record in sorted(records, key=lambda record: Cycles.of(record).frequency):
        cycles = Cycles.of(record)
        measured = {
            "experiment": record.name,
            "role": record.role,
            "frequency_Hz": cycles.frequency,
            "measured_mm": float(of_record(record, record.response, cycles)) / 1e-3,
        }
        for name, fitted in context.candidates.items():
            predicted = of_record(record, context.responses(name, record), cycles) / 1e-3
            rows.append(labels(name, fitted) | measured | interval("predicted", "mm", predicted))
    return Analysis.of_rows(
        {"amplitude_frequency": rows}, {"bands": predicted_curve(context, records, volts)}
    )


def of_record(experiment: Experiment, curves: FloatArray, cycles: Cycles) -> FloatArray:
    """Mean peak-to-peak displacement of the last cycles of curves (..., N) [m]."""
    times = cycles.times(PHASES)[-LAST:]
    loops = resampled(experiment.coordinate, curves, times)
    return np.asarray(np.mean(np.ptp(loops, axis=-1), axis=-1))


def predicted_curve(context: StudyContext, records: list[Experiment], volts: float) -> xr.Dataset:
    """Predicted bands (candidate, bound, frequency) over the range of the records' frequencies."""
    cycles = [Cycles.of(record) for record in records]
    ends = [each.frequency for each in cycles]
    first, last = (min(ends), max(ends)) if len(ends) > 1 else (0.5 * ends[0], 2.0 * ends[0])
    grid = np.geomspace(first, last, FREQUENCIES)
    count = int(np.median([each.numbers[-1] for each in cycles]))

    def wave(turns: FloatArray) -> FloatArray:
        return volts * np.sin(2.0 * np.pi * turns)

    predicted = settled_bands(context, grid, wave, count, LAST, DRAWS)
    return curve_set(
        context,
        {"frequency": (grid, "Hz")},
        {"predicted": (predicted, "m")},
        amplitude_kV=volts / 1e3,
        cycles=count,
    )


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one panel."""
    bands, table = analysis.curves["bands"], analysis.tables["amplitude_frequency"]
    figure, ((ax,),) = panels.grid(1, 1, 2.6, 0.7)
    frequency = bands["frequency"].values
    panels.draw_candidates(ax, frequency, 1e3 * bands["predicted"].values)
    measured = table.drop_duplicates("experiment")
    for role, fill in (("calibrate", style.BLACK), ("validate", "white")):
        rows = measured[measured["role"] == role]
        if len(rows):
            ax.plot(rows["frequency_Hz"], rows["measured_mm"], "o", color=style.BLACK,
                    markerfacecolor=fill, markersize=4, zorder=5,
                    label=f"measured, {ROLES[role]}")  # fmt: skip
    panels.logarithmic(ax, frequency)
    ax.set_xlabel("frequency of the voltage (Hz)")
    ax.set_ylabel("peak-to-peak displacement (mm)")
    ax.set_title(f"sine of {short(bands.attrs['amplitude_kV'])} kV", loc="left")
    entries = [*panels.labelled(ax), *panels.handles(bands, measured=False)]
    panels.legend_below(figure, entries, 3)
    return [figure]
