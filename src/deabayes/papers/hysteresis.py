"""Hysteresis loops of displacement against voltage: area, creep and stability per cycle."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers.base import Analysis, Row, StudyContext, band, curve_set, interval, labels
from deabayes.papers.timing import PHASES, Cycles, Loops, amplitude
from deabayes.quantities import short

SYSTEMS = ("membrane", "minimum_energy_structure")
TITLE = "Hysteresis under alternating voltage"
CAPTION = (
    "Loop area of a cycle: −∮ u d|Φ|, positive if the displacement lags. Under a voltage of both "
    "signs the displacement has twice the voltage's frequency and the loop is a butterfly; under a "
    "biased voltage it is a single loop. Mean: of the displacement over the cycle; drift: change "
    "of the mean per cycle since the cycle before; creep: rise of the mean from the first cycle to "
    "the last. A loop is stable from the first cycle after which, per cycle and to the end, the "
    "area changes by less than 10 % and the mean by less than 2 % of the peak-to-peak "
    "displacement. The cycles before are the transition. If the preparation averaged cycles, a "
    "group counts as its middle cycle."
)
SCOPE = "study"
ANALYSIS = "hysteresis"
FIGURE_TITLE = "Hysteresis loops"
FIGURE_CAPTION = (
    "Left: measured loops from the first cycle (light) to the last (dark), and the last cycle as "
    "the recommended candidate predicts it. Middle: loop area −∮ u d|Φ| of each cycle. Right: mean "
    "displacement of each cycle, whose rise is creep."
)
SHOWN = 4


def compute(context: StudyContext) -> Analysis:
    """Return tables per cycle and per record, and one data set of loops per displacement sine."""
    cycle_rows, stability, loops = [], [], {}
    for record in context.records("displacement", "sine"):
        cycles = Cycles.of(record)
        if cycles.starts.size == 0:
            continue
        measured = Loops.of(record, record.response, cycles)
        bands = []
        for name, fitted in context.candidates.items():
            curves = context.responses(name, record)
            predicted = Loops.of(record, curves, cycles)
            median = Loops.of(record, np.median(curves, axis=0), cycles)
            row = labels(name, fitted)
            row |= {"experiment": record.name, "frequency_Hz": cycles.frequency}
            cycle_rows += [
                row | of_cycle(measured, predicted, k) for k in range(cycles.starts.size)
            ]
            stable_from = {"measured_stable_from": measured.stable_from(),
                           "predicted_stable_from": median.stable_from()}  # fmt: skip
            stability.append(row | stable_from | creep(measured, predicted))
            bands.append(band(predicted.displacement))
        loops[record.name] = curve_set(
            context,
            {"cycle": (measured.numbers, "1"), "phase": (np.linspace(0.0, 1.0, PHASES + 1), "1")},
            {
                "voltage": (measured.voltage, "V"),
                "measured": (measured.displacement, "m"),
                "predicted": (np.array(bands), "m"),
            },
            record,
            frequency_Hz=cycles.frequency,
            amplitude_kV=amplitude(record.excitation) / 1e3,
        )
    tables = {"hysteresis_cycles": cycle_rows, "hysteresis_stability": stability}
    return Analysis.of_rows(tables, loops)


def of_cycle(measured: Loops, predicted: Loops, k: int) -> Row:
    """Row of cycle `k`: measured and predicted values, with the interval of the draws."""
    row: Row = {"cycle": int(measured.numbers[k])}
    kinds = (("area", "kVmm", 1.0), ("mean", "mm", 1e-3), ("peak_to_peak", "mm", 1e-3))
    for name, unit, scale in kinds:
        row[f"measured_{name}_{unit}"] = float(getattr(measured, name)[k]) / scale
        row |= interval(f"predicted_{name}", unit, getattr(predicted, name)[:, k] / scale)
    row["measured_drift_um"] = float(measured.drift[k]) / 1e-6
    return row | interval("predicted_drift", "um", predicted.drift[:, k] / 1e-6)


def creep(measured: Loops, predicted: Loops) -> dict[str, float]:
    """Rise of the mean displacement from the first to the last cycle, measured and predicted."""
    of_draws = predicted.mean[:, -1] - predicted.mean[:, 0]
    return {
        "measured_creep_um": float(measured.mean[-1] - measured.mean[0]) / 1e-6,
        **interval("predicted_creep", "um", of_draws / 1e-6),
    }


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one row per sine, with the highest voltage and then the lowest frequency first."""
    loops = panels.by_size(analysis.curves.values(), "frequency_Hz")[::-1]
    loops = sorted(loops, key=lambda each: -round(float(each.attrs["amplitude_kV"]), 1))
    best, table = results.recommended.name, analysis.tables["hysteresis_cycles"]
    return [_sheet(list(group), table, best) for group in panels.batches(loops, SHOWN)]


def _sheet(loops: list[xr.Dataset], table: pd.DataFrame, best: str) -> Figure:
    figure, axes = panels.grid(len(loops), 3, 1.65 * len(loops) + 0.6, width_ratios=(5, 4, 4))
    for (left, middle, right), record in zip(axes, loops, strict=True):
        rows = table[table["experiment"] == record.attrs["experiment"]]
        _loops(left, record, panels.place_of(best, loops[0]))
        volts, hertz = (short(record.attrs[n], 2) for n in ("amplitude_kV", "frequency_Hz"))
        left.set_title(f"{volts} kV, {hertz} Hz", loc="left")
        _per_cycle(middle, rows, "area", "kVmm", "loop area (kV·mm)")
        _per_cycle(right, rows, "mean", "mm", "mean (mm)")
    for ax, label in zip(axes[-1], ("voltage (kV)", "cycle", "cycle"), strict=True):
        ax.set_xlabel(label)
    entries = [panels.key("measured loops, last dark"), *panels.handles(loops[0])]
    panels.legend_below(figure, entries, 3)
    return figure


def _loops(ax: Axes, record: xr.Dataset, candidate: int) -> None:
    draw_cycles(ax, record)
    last = 1e3 * record["predicted"].values[candidate][:, -1]
    panels.draw_loop(ax, record["voltage"].values[-1] / 1e3, last, candidate)
    ax.set_ylabel("displacement (mm)")


def draw_cycles(ax: Axes, record: xr.Dataset) -> None:
    """Draw the measured loops of a record, from the first (light) to the last (dark)."""
    volts, measured = record["voltage"].values / 1e3, 1e3 * record["measured"].values
    shades = colormaps["Greys"](np.linspace(0.3, 1.0, len(measured)))
    for x, y, shade in zip(volts, measured, shades, strict=True):
        ax.plot(x, y, color=shade, linewidth=0.8)


def _per_cycle(ax: Axes, rows: pd.DataFrame, name: str, unit: str, label: str) -> None:
    columns = [f"predicted_{name}_{end}" for end in ("q05", unit, "q95")]
    for k, (_, own) in enumerate(rows.groupby("candidate", sort=False)):
        panels.draw_candidate(ax, own["cycle"].to_numpy(), own[columns].to_numpy().T, k)
    first = rows[rows["candidate"] == rows["candidate"].iloc[0]]
    ax.plot(first["cycle"], first[f"measured_{name}_{unit}"], "o", color=style.BLACK,
            markersize=2.5)  # fmt: skip
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    ax.set_ylabel(label)
