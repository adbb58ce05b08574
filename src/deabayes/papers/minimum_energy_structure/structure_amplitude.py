"""Amplitude against frequency of the minimum-energy structure, as in its paper's Fig. 9."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, band, beside, interval, labels
from deabayes.papers.timing import Cycles, Loops, Sweep, as_positive
from deabayes.posteriors.fitted import Fitted
from deabayes.quantities import ROLES, short

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Amplitude against frequency (Fig. 9)"
PHASES, KNOTS, DRAWS = 48, 100, 100
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


def compute(context: StudyContext) -> Analysis:
    """Return amplitudes of the sines, predicted curves per voltage, and curves of the sweeps."""
    import pandas as pd

    sines = [e for e in context.records("displacement", "sine") if Cycles.of(e).starts.size]
    if not sines:
        return Analysis()
    sweeps = [e for e in context.records("displacement", "sweep") if Sweep.of(e).frequency.size]
    rows = [
        labels(name, fitted) | record_row(each, context.responses(name, each))
        for name, fitted in context.candidates.items()
        for each in sines
    ]
    tables = {"structure_amplitude": pd.DataFrame(beside(rows, "kV"))}
    curves = {}
    for kilovolts in sorted({round(paper.kilovolts(e), 1) for e in sines}):
        of = [e for e in sines if paper.near(paper.kilovolts(e), kilovolts)]
        swept = [e for e in sweeps if paper.near(paper.kilovolts(e), kilovolts)]
        curves[f"bands_{kilovolts:g}kV"] = bands(context, of, swept)
    resonances = []
    for each in sweeps:
        found = Sweep.of(each)
        curves[each.name] = sweep_curves(context, each, found)
        resonances += [
            labels(name, fitted) | {"experiment": each.name}
            | resonance(found, each.response, context.responses(name, each))
            for name, fitted in context.candidates.items()
        ]  # fmt: skip
    if resonances:
        tables["sweep_resonance"] = pd.DataFrame(resonances)
    return Analysis(tables, curves)


def amplitude_of(experiment: Experiment, curves: FloatArray) -> FloatArray:
    """Peak-to-peak displacement (...) of curves (..., N) in the last whole cycle [m]."""
    return Loops.of(experiment, curves, Cycles.of(experiment)).peak_to_peak[..., -1]


def record_row(experiment: Experiment, curves: FloatArray) -> dict[str, object]:
    """Row of measured and predicted amplitude of a sine."""
    seen = float(amplitude_of(experiment, experiment.response))
    of_draws = amplitude_of(experiment, curves)
    return {
        "frequency_Hz": round(Cycles.of(experiment).frequency, 3),
        "voltage_kV": round(paper.kilovolts(experiment), 1),
        "role": experiment.role,
        "measured_mm": seen / MILLIMETRE,
        **interval("predicted", "mm", of_draws / MILLIMETRE),
        **interval("error", "percent", PERCENT * (of_draws / seen - 1.0)),
    }


def bands(context: StudyContext, sines: list[Experiment], sweeps: list[Experiment]) -> xr.Dataset:
    """Predicted bands (candidate, bound, frequency) at the sines' voltage, and measured values.

    The frequencies span the sines, and continue to the end of the sweeps if there are any.
    """
    sines = sorted(sines, key=lambda e: Cycles.of(e).frequency)
    cycles = [Cycles.of(e) for e in sines]
    at = np.array([each.frequency for each in cycles])
    grid = frequencies(at, sweeps)
    lowest, highest = levels(sines[0])
    count = int(np.median([each.numbers[-1] for each in cycles]))
    names = list(context.candidates)
    predicted = [
        np.stack([band(predicted_amplitude(context.candidates[n], f, lowest, highest, count))
                  for f in grid], axis=1)
        for n in names
    ]  # fmt: skip
    seen = [float(amplitude_of(each, each.response)) for each in sines]
    return xr.Dataset(
        {
            "predicted": (("candidate", "bound", "frequency"), np.array(predicted), {"units": "m"}),
            "measured": ("record", np.array(seen), {"units": "m"}),
            "record_frequency": ("record", at, {"units": "Hz"}),
            "calibrated": ("record", [int(each.role == "calibrate") for each in sines]),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "frequency": ("frequency", grid, {"units": "Hz"}),
        },
        attrs={"amplitude_kV": highest / 1e3, "lowest_kV": lowest / 1e3, "cycles": count,
               "last_sine_Hz": float(at[-1])},
    )  # fmt: skip


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


def predicted_amplitude(
    fitted: Fitted, frequency: float, lowest: float, highest: float, count: int
) -> FloatArray:
    """Peak-to-peak displacement (S,) in the last of `count` cycles from rest [m].

    The drive is the paper's (1), which starts at its lowest voltage.
    """
    turn = np.arange(count * KNOTS + 1) / KNOTS
    middle, half = 0.5 * (highest + lowest), 0.5 * (highest - lowest)
    drive = Excitation(
        "voltage", "V", turn / frequency, middle - half * np.cos(2.0 * np.pi * turn)
    )  # fmt: skip
    times = (count - 1 + np.arange(PHASES + 1) / PHASES) / frequency
    draws = {name: values[:DRAWS] for name, values in fitted.draws.items()}
    curves = fitted.system.predict(drive, times, "displacement", draws)
    return np.asarray(np.ptp(curves[np.all(np.isfinite(curves), axis=1)], axis=1))


def resonance(sweep: Sweep, measured: FloatArray, curves: FloatArray) -> dict[str, float]:
    """Row of frequency and amplitude of the resonance, measured and predicted."""
    seen = sweep.resonance(sweep.amplitude(measured))
    drawn = np.array([sweep.resonance(each) for each in sweep.amplitude(curves)])
    return {
        "measured_resonance_Hz": seen[0],
        **interval("predicted_resonance", "Hz", drawn[:, 0]),
        "measured_height_mm": seen[1] / MILLIMETRE,
        **interval("predicted_height", "mm", drawn[:, 1] / MILLIMETRE),
        "without_percent": PERCENT * float(np.mean(np.isnan(drawn[:, 0]))),
    }


def sweep_curves(context: StudyContext, experiment: Experiment, sweep: Sweep) -> xr.Dataset:
    """Measured amplitude and predicted bands (candidate, bound, frequency) along a sweep."""
    names = list(context.candidates)
    drawn = [band(sweep.amplitude(context.responses(name, experiment))) for name in names]
    return xr.Dataset(
        {
            "predicted": (("candidate", "bound", "frequency"), np.array(drawn), {"units": "m"}),
            "measured": ("frequency", sweep.amplitude(experiment.response), {"units": "m"}),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "frequency": ("frequency", sweep.frequency, {"units": "Hz"}),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "amplitude_kV": paper.kilovolts(experiment)},
    )  # fmt: skip


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


def draw(results: StudyResults) -> list[Figure]:
    """Return one panel per voltage of the sines and one panel per sweep."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    sines = panels.by_size([c for n, c in found.curves.items() if n.startswith(BANDS)],
                           "amplitude_kV")  # fmt: skip
    sweeps = [c for n, c in found.curves.items() if not n.startswith(BANDS)]
    count = len(sines) + len(sweeps)
    figure, axes = panels.sheet(count, 2.3)
    for ax, record in zip(axes, sines, strict=False):
        _sines(ax, record)
    for ax, record in zip(axes[len(sines) :], sweeps, strict=True):
        _sweep(ax, record)
    panels.legend_below(figure, [*_roles(), *panels.handles(sines[0], measured=False)], 4)
    return [figure]


def _sines(ax: Axes, record: xr.Dataset) -> None:
    frequency, last = record["frequency"].values, float(record.attrs["last_sine_Hz"])
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, frequency, 1e3 * record["predicted"].values[k], k)
    fitted = record["calibrated"].values.astype(bool)
    at, seen = record["record_frequency"].values, 1e3 * record["measured"].values
    for part, fill in ((fitted, style.BLACK), (~fitted, "white")):
        ax.plot(at[part], seen[part], "o", color=style.BLACK, markerfacecolor=fill, markersize=3.5,
                zorder=5)  # fmt: skip
    if frequency[-1] > (1.0 + WIDTH) * last:
        ax.axvspan(last, frequency[-1], color="#ececec", zorder=0, linewidth=0)
    _axes(ax, frequency, f"sines of {short(float(record.attrs['amplitude_kV']), 2)} kV")


def _sweep(ax: Axes, record: xr.Dataset) -> None:
    frequency = record["frequency"].values
    for k in range(record["candidate"].size):
        panels.draw_candidate(ax, frequency, 1e3 * record["predicted"].values[k], k)
    ax.plot(frequency, 1e3 * record["measured"].values, ".", color=MEASURED, markersize=4.0,
            markeredgewidth=0, zorder=1.5)  # fmt: skip
    title = f"sweep of {short(float(record.attrs['amplitude_kV']), 2)} kV"
    _axes(ax, frequency, f"{title}, {ROLES[str(record.attrs['role'])]}")


def _axes(ax: Axes, frequency: np.ndarray, title: str) -> None:
    panels.logarithmic(ax, frequency)
    ax.set_xlabel("frequency of the voltage (Hz)")
    ax.set_ylabel("peak to peak (mm)")
    ax.set_title(title, loc="left")
    ax.set_ylim(bottom=0.0)


def _roles() -> list[Line2D]:
    return [
        Line2D([], [], color=style.BLACK, marker="o", linestyle="none", markerfacecolor=fill,
               markersize=3.5, label=f"measured, {ROLES[role]}")
        for role, fill in (("calibrate", style.BLACK), ("validate", "white"))
    ] + [Line2D([], [], color=MEASURED, marker=".", linestyle="none", markersize=4.0,
                label="measured, sweep")]  # fmt: skip
