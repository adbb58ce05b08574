"""Hysteresis loops of displacement against voltage: area, creep and stability per cycle."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers.base import Analysis, StudyContext, band, interval, labels
from deabayes.papers.timing import PHASES, Cycles, Loops, amplitude
from deabayes.quantities import short

SYSTEMS = ("membrane", "minimum_energy_structure")
TITLE = "Hysteresis under alternating voltage"
CAPTION = (
    "Loop area of a cycle: −∮ u d|Φ|, positive where the displacement lags. Under a voltage of "
    "both signs the displacement moves at twice the voltage's frequency and the loop is a "
    "butterfly; under a biased one it is a single loop. Mean: of the displacement over the cycle; "
    "drift: its change per cycle since the cycle before, the creep; creep: from the first cycle to "
    "the last. A loop counts as stable from the first cycle after which its area changes by less "
    "than 10 % and its mean by less than 2 % of the cycle's peak-to-peak displacement, per cycle, "
    "to the end; what is before is the transition. Where the preparation averaged cycles, a "
    "group counts as its middle one."
)


def compute(context: StudyContext) -> Analysis:
    """Return tables per cycle and per record, and one data set of loops per displacement sine."""
    cycles, stability, loops = [], [], {}
    for each in context.records("displacement", "sine"):
        found = Cycles.of(each)
        if found.starts.size == 0:
            continue
        measured = Loops.of(each, each.response, found)
        record = {"experiment": each.name, "frequency_Hz": found.frequency}
        bands = []
        for name, fitted in context.candidates.items():
            predicted = Loops.of(each, context.responses(name, each), found)
            middle = Loops.of(each, np.median(context.responses(name, each), axis=0), found)
            row = labels(name, fitted) | record
            cycles += [row | of_cycle(measured, predicted, k) for k in range(found.starts.size)]
            stability.append(row | {"measured_stable_from": measured.stable_from(),
                                    "predicted_stable_from": middle.stable_from()}
                             | creep(measured, predicted))  # fmt: skip
            bands.append(band(predicted.displacement))
        loops[each.name] = loop_curves(context, each, measured, np.array(bands))
    tables = {"hysteresis_cycles": cycles, "hysteresis_stability": stability}
    return Analysis({name: pd.DataFrame(rows) for name, rows in tables.items() if rows}, loops)


def of_cycle(measured: Loops, predicted: Loops, k: int) -> dict[str, object]:
    """Row of cycle `k`: measured and predicted values, with the interval of the draws."""
    row: dict[str, object] = {"cycle": int(measured.numbers[k])}
    kinds = (("area", "kVmm", 1.0), ("mean", "mm", 1e-3), ("peak_to_peak", "mm", 1e-3))
    for name, unit, scale in kinds:
        row[f"measured_{name}_{unit}"] = float(getattr(measured, name)[k]) / scale
        row |= interval(f"predicted_{name}", unit, getattr(predicted, name)[:, k] / scale)
    row["measured_drift_um"] = float(measured.drift[k]) / 1e-6
    return row | interval("predicted_drift", "um", predicted.drift[:, k] / 1e-6)


def creep(measured: Loops, predicted: Loops) -> dict[str, float]:
    """Rise of the mean displacement from the first to the last cycle, measured and predicted."""
    found = {"measured_creep_um": float(measured.mean[-1] - measured.mean[0]) / 1e-6}
    of_draws = predicted.mean[:, -1] - predicted.mean[:, 0]
    return found | interval("predicted_creep", "um", of_draws / 1e-6)


def loop_curves(
    context: StudyContext, experiment: Experiment, measured: Loops, bands: FloatArray
) -> xr.Dataset:
    """Data set of measured and predicted loops; `bands` is (candidate, bound, cycle, phase)."""
    names = list(context.candidates)
    loop = ("cycle", "phase")
    return xr.Dataset(
        {
            "voltage": (loop, measured.voltage, {"units": "V"}),
            "measured": (loop, measured.displacement, {"units": "m"}),
            "predicted": (("candidate", "bound", *loop), bands, {"units": "m"}),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "cycle": measured.numbers,
            "phase": np.linspace(0.0, 1.0, PHASES + 1),
        },
        attrs={"experiment": experiment.name, "role": experiment.role,
               "frequency_Hz": Cycles.of(experiment).frequency,
               "amplitude_kV": amplitude(experiment.excitation) / 1e3},
    )  # fmt: skip


SCOPE = "study"
ANALYSIS = "hysteresis"
FIGURE_TITLE = "Hysteresis loops"
FIGURE_CAPTION = (
    "Left: measured loops from the first cycle (light) to the last (dark), and the last cycle as "
    "the recommended candidate predicts it. Middle: loop area −∮ u d|Φ| of each cycle. Right: mean "
    "displacement of each cycle, whose rise is creep."
)
SHOWN = 4


def draw(results: StudyResults) -> list[Figure]:
    """Return one row per sine, with the highest voltage and then the lowest frequency first."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    loops = panels.by_size(list(found.curves.values()), "frequency_Hz")[::-1]
    loops = sorted(loops, key=lambda each: -round(float(each.attrs["amplitude_kV"]), 1))
    best, table = results.recommended.name, found.tables["hysteresis_cycles"]
    return [_sheet(list(group), table, best) for group in panels.batches(loops, SHOWN)]


def _sheet(loops: list[xr.Dataset], table: pd.DataFrame, best: str) -> Figure:
    height = 1.65 * len(loops) + 0.6 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    axes = figure.subplots(len(loops), 3, squeeze=False, width_ratios=(5, 4, 4))
    names = [str(name) for name in loops[0]["candidate"].values]
    shown = best if best in names else names[0]
    for row, record in zip(axes, loops, strict=True):
        rows = table[table["experiment"] == record.attrs["experiment"]]
        _loops(row[0], record, names.index(shown))
        volts, hertz = (short(record.attrs[n], 2) for n in ("amplitude_kV", "frequency_Hz"))
        row[0].set_title(f"{volts} kV, {hertz} Hz", loc="left")
        for ax, (name, unit, label) in zip(
            row[1:], (("area", "kVmm", "loop area (kV·mm)"), ("mean", "mm", "mean (mm)")),
            strict=True,
        ):  # fmt: skip
            _per_cycle(ax, rows, names, name, unit)
            ax.set_ylabel(label)
    for ax, label in zip(axes[-1], ("voltage (kV)", "cycle", "cycle"), strict=True):
        ax.set_xlabel(label)
    entries = [
        Line2D([], [], color=style.BLACK, label="measured loops, last dark"),
        *panels.handles(loops[0]),
    ]
    panels.legend_below(figure, entries, 3)
    return figure


def _loops(ax: Axes, record: xr.Dataset, candidate: int) -> None:
    volts, measured = record["voltage"].values / 1e3, 1e3 * record["measured"].values
    count = len(measured)
    shades = colormaps["Greys"](np.linspace(0.3, 1.0, count))
    for k in range(count):
        ax.plot(volts[k], measured[k], color=shades[k], linewidth=0.8)
    lower, median, upper = 1e3 * record["predicted"].values[candidate][:, -1]
    panels.fill_loop(ax, volts[-1], lower, upper, candidate)
    ax.plot(volts[-1], median, color=panels.colour(candidate), linestyle=panels.line(candidate))
    ax.set_ylabel("displacement (mm)")


def _per_cycle(ax: Axes, rows: pd.DataFrame, names: list[str], name: str, unit: str) -> None:
    column = f"predicted_{name}"
    for k, candidate in enumerate(names):
        own = rows[rows["candidate"] == candidate]
        keys = (f"{column}_q05", f"{column}_{unit}", f"{column}_q95")
        bands = np.array([own[key].to_numpy() for key in keys])
        panels.draw_candidate(ax, own["cycle"].to_numpy(), bands, k)
    own = rows[rows["candidate"] == names[0]]
    ax.plot(own["cycle"], own[f"measured_{name}_{unit}"], "o", color=style.BLACK, markersize=2.5)
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=True))
