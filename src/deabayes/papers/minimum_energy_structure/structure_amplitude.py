"""Amplitude against frequency of the minimum-energy structure, as in its paper's Fig. 9."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.amplitude import settled_bands
from deabayes.papers.base import Analysis, StudyContext, bands, beside, curve_set, interval, labels
from deabayes.papers.timing import Cycles, Loops, Sweep, as_positive, near
from deabayes.quantities import ROLES, short

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Amplitude against frequency (Fig. 9)"
DRAWS = 100
"""Number of draws of the predicted curve."""
WITHIN, BEYOND = 12, 16
"""Numbers of frequencies of the predicted curve: over the sines, and on to the sweep's end."""
PERCENT, MILLIMETRE = 100.0, 1e-3
CAPTION = (
    "Peak-to-peak displacement in the last whole cycle of each sine, measured beside predicted "
    "(median, 5 to 95 % interval of the draws: neither discrepancy nor noise is in them), and the "
    "error (predicted − measured) / measured, both voltages side by side. Resonance: the highest "
    "rise of a sweep's amplitude above the falls on both its sides, and how high it is (without: "
    "share of the draws that have none). Amplitudes along a sweep are those of the fundamental "
    "and second harmonic of the voltage's phase, fitted to successive points, the prediction read "
    "alike; frequencies whose harmonics the record's points cannot tell apart are left out. The "
    "paper shows its amplitudes as a figure only."
)
SCOPE = "study"
ANALYSIS = "structure_amplitude"
FIGURE_TITLE = "Amplitude against frequency of the structure"
BANDS, WIDTH = "bands_", 0.02
MEASURED = "#8c8c8c"
FIGURE_CAPTION = (
    "Peak-to-peak displacement in the settled cycle against the voltage's frequency: measured "
    "sines (filled: fitted) and predicted curves (median, interval of the draws); grey: the "
    "frequencies beyond the sines, an extrapolation. Where a sweep was recorded, its measured "
    "amplitude (dots) and what each candidate predicts for it in the panel beside: a sweep is "
    "read from a few cycles at a time, and starts before the creep has settled."
)


def compute(context: StudyContext) -> Analysis:
    """Return amplitudes of the sines, predicted curves per voltage, and curves of the sweeps."""
    sines = [e for e in context.records("displacement", "sine") if Cycles.of(e).starts.size]
    if not sines:
        return Analysis()
    sweeps = [e for e in context.records("displacement", "sweep") if Sweep.of(e).frequency.size]
    rows = [first | record_row(e, curves) for first, e, curves in context.predicted(sines)]
    curves = {}
    for kilovolts in sorted({round(paper.kilovolts(e), 1) for e in sines}):
        of_voltage = [
            [e for e in records if near(paper.kilovolts(e), kilovolts)]
            for records in (sines, sweeps)
        ]
        curves[f"bands_{kilovolts:g}kV"] = sine_curves(context, *of_voltage)
    curves |= {e.name: sweep_curves(context, e) for e in sweeps}
    resonances = [
        labels(name, fitted)
        | {"experiment": e.name}
        | resonance(Sweep.of(e), e.response, context.responses(name, e))
        for e in sweeps
        for name, fitted in context.candidates.items()
    ]
    tables = {"structure_amplitude": beside(rows), "sweep_resonance": resonances}
    return Analysis.of_rows(tables, curves)


def amplitude_of(experiment: Experiment, curves: FloatArray) -> FloatArray:
    """Peak-to-peak displacement (...) of curves (..., N) in the last whole cycle [m]."""
    return Loops.of(experiment, curves, Cycles.of(experiment)).peak_to_peak[..., -1]


def record_row(experiment: Experiment, curves: FloatArray) -> dict[str, object]:
    """Row of measured and predicted amplitude of a sine."""
    measured = float(amplitude_of(experiment, experiment.response))
    of_draws = amplitude_of(experiment, curves)
    return {
        "frequency_Hz": round(Cycles.of(experiment).frequency, 3),
        "voltage_kV": round(paper.kilovolts(experiment), 1),
        "role": experiment.role,
        "measured_mm": measured / MILLIMETRE,
        **interval("predicted", "mm", of_draws / MILLIMETRE),
        **interval("error", "percent", PERCENT * (of_draws / measured - 1.0)),
    }


def sine_curves(
    context: StudyContext, sines: list[Experiment], sweeps: list[Experiment]
) -> xr.Dataset:
    """Predicted bands (candidate, bound, frequency) at the sines' voltage, and measured values.

    The frequencies span the sines, and continue to the end of the sweeps if there are any. The
    drive is the paper's (1), which starts at its lowest voltage.
    """
    sines = sorted(sines, key=lambda e: Cycles.of(e).frequency)
    cycles = [Cycles.of(e) for e in sines]
    at = np.array([each.frequency for each in cycles])
    grid = frequencies(at, sweeps)
    lowest, highest = levels(sines[0])
    middle, half = 0.5 * (highest + lowest), 0.5 * (highest - lowest)

    def wave(turns: FloatArray) -> FloatArray:
        return middle - half * np.cos(2.0 * np.pi * turns)

    count = int(np.median([each.numbers[-1] for each in cycles]))
    predicted = settled_bands(context, grid, wave, count, 1, DRAWS)
    measured = np.array([float(amplitude_of(each, each.response)) for each in sines])
    return curve_set(
        context,
        {"frequency": (grid, "Hz")},
        {"predicted": (predicted, "m")},
        amplitude_kV=highest / 1e3,
        lowest_kV=lowest / 1e3,
        cycles=count,
        last_sine_Hz=float(at[-1]),
    ).assign(
        measured=("record", measured, {"units": "m"}),
        record_frequency=("record", at, {"units": "Hz"}),
        calibrated=("record", [int(each.role == "calibrate") for each in sines]),
    )


def frequencies(at: FloatArray, sweeps: list[Experiment]) -> FloatArray:
    """Frequencies of the predicted curve: over the sines, and on to the sweeps' end [Hz].

    `at` holds the frequencies of the sines in ascending order.
    """
    grid = np.geomspace(at[0], at[-1], WITHIN) if at[-1] > at[0] else at[:1]
    end = max((float(Sweep.of(each).frequency[-1]) for each in sweeps), default=0.0)
    if end <= at[-1]:
        return grid
    return np.append(grid, np.geomspace(at[-1], end, BEYOND + 1)[1:])


def levels(experiment: Experiment) -> tuple[float, float]:
    """Lowest and highest voltage of a sine [V], after the start of its second cycle.

    For a purely negative voltage they are magnitudes, which cause the same motion.
    """
    drive = as_positive(experiment.excitation)
    start = Cycles.driven(drive).starts[:2]
    during = drive.values[drive.coordinate > start[-1]] if start.size else drive.values
    return float(during.min()), float(during.max())


def resonance(sweep: Sweep, measured: FloatArray, curves: FloatArray) -> dict[str, float]:
    """Row of frequency and amplitude of the resonance, measured and predicted."""
    of_record = sweep.resonance(sweep.amplitude(measured))
    drawn = np.array([sweep.resonance(each) for each in sweep.amplitude(curves)])
    return {
        "measured_resonance_Hz": of_record[0],
        **interval("predicted_resonance", "Hz", drawn[:, 0]),
        "measured_height_mm": of_record[1] / MILLIMETRE,
        **interval("predicted_height", "mm", drawn[:, 1] / MILLIMETRE),
        "without_percent": PERCENT * float(np.mean(np.isnan(drawn[:, 0]))),
    }


def sweep_curves(context: StudyContext, experiment: Experiment) -> xr.Dataset:
    """Measured amplitude and predicted bands (candidate, bound, frequency) along a sweep."""
    sweep = Sweep.of(experiment)
    return curve_set(
        context,
        {"frequency": (sweep.frequency, "Hz")},
        {
            "predicted": (bands(context, experiment, sweep.amplitude), "m"),
            "measured": (sweep.amplitude(experiment.response), "m"),
        },
        experiment,
        amplitude_kV=paper.kilovolts(experiment),
    )


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one panel per voltage of the sines and one panel per sweep."""
    of_sines = [c for name, c in analysis.curves.items() if name.startswith(BANDS)]
    sines = panels.by_size(of_sines, "amplitude_kV")
    sweeps = [c for name, c in analysis.curves.items() if not name.startswith(BANDS)]
    figure, axes = panels.sheet(len(sines) + len(sweeps), 2.3)
    for ax, record in zip(axes, [*sines, *sweeps], strict=True):
        _panel(ax, record)
        if "calibrated" in record:
            _sines(ax, record)
        else:
            _sweep(ax, record)
    entries = [
        *panels.role_handles(before="measured, ", markersize=3.5),
        panels.key("measured, sweep", MEASURED, marker=".", markersize=4.0),
        *panels.handles(sines[0], measured=False),
    ]
    panels.legend_below(figure, entries, 4)
    return [figure]


def _panel(ax: Axes, record: xr.Dataset) -> None:
    """Draw the predicted amplitudes of sines or of a sweep."""
    frequency = record["frequency"].values
    panels.draw_candidates(ax, frequency, 1e3 * record["predicted"].values)
    panels.logarithmic(ax, frequency)
    ax.set_xlabel("frequency of the voltage (Hz)")
    ax.set_ylabel("peak to peak (mm)")


def _sines(ax: Axes, record: xr.Dataset) -> None:
    frequency, last = record["frequency"].values, float(record.attrs["last_sine_Hz"])
    calibrated = record["calibrated"].values.astype(bool)
    at, measured = record["record_frequency"].values, 1e3 * record["measured"].values
    points: dict[str, Any] = {"marker": "o", "color": style.BLACK, "zorder": 5}
    panels.draw_by_role(ax, at, measured, calibrated, **points)
    if frequency[-1] > (1.0 + WIDTH) * last:
        ax.axvspan(last, frequency[-1], color="#ececec", zorder=0, linewidth=0)
    ax.set_title(f"sines of {short(float(record.attrs['amplitude_kV']), 2)} kV", loc="left")
    ax.set_ylim(bottom=0.0)


def _sweep(ax: Axes, record: xr.Dataset) -> None:
    ax.plot(record["frequency"].values, 1e3 * record["measured"].values, ".", color=MEASURED,
            markersize=4.0, markeredgewidth=0, zorder=1.5)  # fmt: skip
    volts, role = short(float(record.attrs["amplitude_kV"]), 2), str(record.attrs["role"])
    ax.set_title(f"sweep of {volts} kV, {ROLES[role]}", loc="left")
    ax.set_ylim(bottom=0.0)
