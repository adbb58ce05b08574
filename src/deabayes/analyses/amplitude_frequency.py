"""Peak-to-peak displacement of the settled response against the voltage's frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deabayes.analyses.base import Analysis, StudyContext
from deabayes.analyses.drive import Cycles, amplitude, resampled
from deabayes.analyses.summaries import band, interval, labels
from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.posteriors.fitted import Fitted

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
    """A table over the records, and bands over a grid of frequencies that spans them."""
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
    """Predicted (candidate, bound, frequency) over the records' frequencies."""
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
    """Peak-to-peak displacement (S,) of the last of `count` cycles from rest [m]."""
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
