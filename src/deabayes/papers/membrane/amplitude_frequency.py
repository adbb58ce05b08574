"""Peak-to-peak displacement of the settled response against the voltage's frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers.base import Analysis, StudyContext, band, interval, labels
from deabayes.papers.timing import Cycles, amplitude, resampled
from deabayes.posteriors.fitted import Fitted
from deabayes.quantities import ROLES, short

if TYPE_CHECKING:
    import xarray as xr

SYSTEMS = ("membrane",)
TITLE = "Amplitude against frequency"
LAST, PHASES, FREQUENCIES, KNOTS = 2, 48, 15, 100
DRAWS = 200
SAME_AMPLITUDE = 0.02
CAPTION = (
    "Peak-to-peak displacement, mean of the last two cycles, under a sine of the records' "
    "amplitude; frequency is the voltage's. Medians with 5 to 95 % intervals of the draws (the "
    "model's own: neither discrepancy nor noise is in them)."
)


def compute(context: StudyContext) -> Analysis:
    """Return a table of the records, and bands over a grid that spans their frequencies."""
    import pandas as pd

    records = [
        each for each in context.records("displacement", "sine")
        if Cycles.of(each).starts.size >= LAST
    ]  # fmt: skip
    if not records:
        return Analysis()
    volts = float(np.median([amplitude(each.excitation) for each in records]))
    records = [
        each for each in records
        if abs(amplitude(each.excitation) - volts) < SAME_AMPLITUDE * volts
    ]  # fmt: skip
    rows = []
    for each in sorted(records, key=lambda e: Cycles.of(e).frequency):
        cycles = Cycles.of(each)
        seen = float(of_record(each, each.response, cycles)) / 1e-3
        for name, fitted in context.candidates.items():
            predicted = of_record(each, context.responses(name, each), cycles) / 1e-3
            row = {"experiment": each.name, "role": each.role, "frequency_Hz": cycles.frequency}
            row |= {"measured_mm": seen} | interval("predicted", "mm", predicted)
            rows.append(labels(name, fitted) | row)
    return Analysis(
        {"amplitude_frequency": pd.DataFrame(rows)}, {"bands": bands(context, records, volts)}
    )


def of_record(experiment: Experiment, curves: FloatArray, cycles: Cycles) -> FloatArray:
    """Mean peak-to-peak displacement of the last cycles of curves (..., N) [m]."""
    times = cycles.times(PHASES)[-LAST:]
    loops = resampled(experiment.coordinate, curves, times)
    return np.asarray(np.mean(np.ptp(loops, axis=-1), axis=-1))


def bands(context: StudyContext, records: list[Experiment], volts: float) -> xr.Dataset:
    """Predicted bands (candidate, bound, frequency) over the range of the records' frequencies."""
    import xarray as xr

    found = [Cycles.of(each) for each in records]
    ends = [each.frequency for each in found]
    first, last = (min(ends), max(ends)) if len(ends) > 1 else (0.5 * ends[0], 2.0 * ends[0])
    grid = np.geomspace(first, last, FREQUENCIES)
    count = int(np.median([each.numbers[-1] for each in found]))
    names = list(context.candidates)
    predicted = np.array([
        np.stack([band(predicted_amplitude(context.candidates[name], f, volts, count))
                  for f in grid], axis=1)
        for name in names
    ])  # fmt: skip
    return xr.Dataset(
        {"predicted": (("candidate", "bound", "frequency"), predicted, {"units": "m"})},
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "frequency": ("frequency", grid, {"units": "Hz"}),
        },
        attrs={"amplitude_kV": volts / 1e3, "cycles": count},
    )


def predicted_amplitude(fitted: Fitted, frequency: float, volts: float, count: int) -> FloatArray:
    """Mean peak-to-peak displacement (S,) of the last `LAST` of `count` cycles from rest [m]."""
    phase = np.arange(count * KNOTS + 1) / KNOTS
    drive = Excitation(
        "voltage", "V", phase / frequency, volts * np.sin(2.0 * np.pi * phase)
    )  # fmt: skip
    last = min(LAST, count)
    times = (count - last + np.arange(last * PHASES + 1) / PHASES) / frequency
    draws = {name: values[:DRAWS] for name, values in fitted.draws.items()}
    curves = fitted.system.predict(drive, times, "displacement", draws)
    curves = curves[np.all(np.isfinite(curves), axis=1)]
    parts = [curves[:, k * PHASES : (k + 1) * PHASES + 1] for k in range(last)]
    return np.asarray(np.mean([np.ptp(part, axis=1) for part in parts], axis=0))


SCOPE = "study"
ANALYSIS = "amplitude_frequency"
FIGURE_TITLE = "Amplitude against frequency"
FIGURE_CAPTION = (
    "Peak-to-peak displacement of the last cycles against the voltage's frequency: measured, and "
    "as each candidate predicts it (median, interval of the draws)."
)


def draw(results: StudyResults) -> list[Figure]:
    """Return one panel."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    bands, table = found.curves["bands"], found.tables["amplitude_frequency"]
    width = 0.7 * style.DOUBLE_COLUMN
    figure = Figure(figsize=(width, 2.6 + style.HEADER), layout="constrained")
    ax = figure.subplots()
    frequency = bands["frequency"].values
    for k in range(bands["candidate"].size):
        panels.draw_candidate(ax, frequency, 1e3 * bands["predicted"].values[k], k)
    seen = table.drop_duplicates("experiment")
    entries: list[Line2D | Patch] = []
    for role, fill in (("calibrate", style.BLACK), ("validate", "white")):
        rows = seen[seen["role"] == role]
        if len(rows):
            entries += ax.plot(rows["frequency_Hz"], rows["measured_mm"], "o", color=style.BLACK,
                               markerfacecolor=fill, markersize=4, zorder=5,
                               label=f"measured, {ROLES[role]}")  # fmt: skip
    panels.logarithmic(ax, frequency)
    ax.set_xlabel("frequency of the voltage (Hz)")
    ax.set_ylabel("peak-to-peak displacement (mm)")
    ax.set_title(f"sine of {short(bands.attrs['amplitude_kV'])} kV", loc="left")
    panels.legend_below(figure, [*entries, *panels.handles(bands, measured=False)], 3)
    return [figure]
