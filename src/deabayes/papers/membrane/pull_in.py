"""Voltage at which a membrane's near equilibrium ends, and steady stretch below it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, Row, StudyContext, band, curve_set, interval, labels
from deabayes.papers.timing import STEPS, amplitude, since_step
from deabayes.posteriors.fitted import Fitted
from deabayes.quantities import short

if TYPE_CHECKING:
    from deabayes.systems.membrane.system import Membrane

SYSTEMS = ("membrane",)
TITLE = "Pull-in and steady stretch"
VOLTAGES = (2.0, 3.0, 4.0)
POINTS = 81
BEYOND = 1.25
"""The curves reach this many times the highest voltage of the records."""
CAPTION = (
    "Voltage at which the near equilibrium ends; where its branch folds that is pull-in, else it "
    "is where the stretch reaches the breakdown stretch or the springs lock up (fold: share of "
    "the draws that fold). Steady stretch: that of the near equilibrium under a constant voltage; "
    "beyond: share of the draws that have none. Medians with 5 to 95 % intervals. The paper prints "
    "neither: its parameters with stand-in Gent limits have the equilibria in the column "
    "“paper parameters”, and without Gent limits pull in at 3.75 kV."
)
SCOPE = "study"
ANALYSIS = "pull_in"
FIGURE_TITLE = "Steady stretch and pull-in"
FIGURE_CAPTION = (
    "Left: stretch of the near equilibrium against voltage, as far as at least half of the draws "
    "have one (median, interval of the draws), and the stretch at the end of each step record, "
    "which still creeps. Right: voltage at which the near equilibrium ends, median and interval; "
    "beyond the records' voltages (dotted) it rests on the springs' law and the prior of the Gent "
    "limit. Above each point the share of draws whose branch folds there, which is pull-in; in "
    "the others the stretch reaches breakdown or the springs lock up."
)
HALF = 0.5


def compute(context: StudyContext) -> Analysis:
    """Return pull-in and steady stretch per candidate, and steady stretch against voltage."""
    ends, steady = [], []
    for name, fitted in context.candidates.items():
        end, first = membrane(fitted).pull_in(fitted.draws), labels(name, fitted)
        ends.append(
            first
            | interval("pull_in", "kV", end.voltage / 1e3)
            | interval("stretch_there", "", end.stretch)
            | {"fold_percent": 100.0 * float(np.mean(end.fold))}
        )
        steady += [first | steady_row(fitted, kilovolt) for kilovolt in VOLTAGES]
    tables = {"pull_in": ends, "steady_stretch": steady}
    return Analysis.of_rows(tables, {"steady_stretch": steady_curves(context)})


def membrane(fitted: Fitted) -> Membrane:
    """Return the forward model of a candidate, which must be a membrane."""
    from deabayes.systems.membrane.system import Membrane

    assert isinstance(fitted.system, Membrane)
    return fitted.system


def steady_row(fitted: Fitted, kilovolt: float) -> Row:
    """Row of the steady stretch at one voltage, and of the share of draws that have none."""
    stretch = membrane(fitted).steady_stretch(fitted.draws, 1e3 * kilovolt)
    return {
        "voltage_kV": kilovolt,
        **interval("steady_stretch", "", stretch),
        "beyond_percent": 100.0 * float(np.mean(~np.isfinite(stretch))),
        "paper_parameters": paper.STEADY_STRETCH[kilovolt],
    }


def steady_curves(context: StudyContext) -> xr.Dataset:
    """Bands (candidate, bound, voltage) of the draws with a near equilibrium, and their share.

    The data set also holds the stretch at the end of each step record, which is not yet steady.
    """
    records = context.records("displacement", *STEPS)
    volts = np.array([amplitude(each.excitation) for each in records])
    grid = np.linspace(0.0, BEYOND * (volts.max() if volts.size else 4e3), POINTS)
    bands, shares = zip(*(steady_band(f, grid) for f in context.candidates.values()), strict=True)
    size, rest = (context.specimen.quantities[n].value for n in ("side_length", "prestretch"))
    last = np.array([rest + float(each.response[-1]) / size for each in records])
    return curve_set(
        context,
        {"voltage": (grid, "V")},
        {"stretch": (np.array(bands), "1"), "share": (np.array(shares), "1")},
    ).assign(
        record_stretch=("record", last),
        record_voltage=("record", volts),
        record_duration=("record", np.array([since_step(each)[-1] for each in records])),
    ).assign_coords(record=[each.name for each in records])  # fmt: skip


def steady_band(fitted: Fitted, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Band (3, V) of the steady stretch and share (V,) of the draws that have one."""
    stretch = np.array([membrane(fitted).steady_stretch(fitted.draws, volts) for volts in grid])
    there = np.isfinite(stretch)
    bands = np.full((3, grid.size), np.nan)
    for k in np.flatnonzero(there.any(axis=1)):
        bands[:, k] = band(stretch[k, there[k], None])[:, 0]
    return bands, there.mean(axis=1)


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return two panels: steady stretch against voltage, and end of the near equilibrium."""
    steady, ends = analysis.curves["steady_stretch"], analysis.tables["pull_in"]
    figure, ((left, right),) = panels.grid(1, 2, 2.5, width_ratios=(3, 2))
    _steady(left, steady)
    _ends(right, ends)
    entries = panels.handles(steady, measured=False)
    if steady["record"].size:
        highest = float(steady["record_voltage"].max()) / 1e3
        right.axvline(highest, color=style.GREY, linestyle=":", linewidth=0.8)
        last = short(float(steady["record_duration"].max()), 3)
        entries.insert(0, panels.key(f"record at its end, {last} s", marker="o", markersize=3))
    panels.legend_below(figure, entries, 5)
    return [figure]


def _steady(ax: Axes, steady: xr.Dataset) -> None:
    volts = steady["voltage"].values / 1e3
    for k in range(steady["candidate"].size):
        shown = steady["share"].values[k] >= HALF
        panels.draw_candidate(ax, volts[shown], steady["stretch"].values[k][:, shown], k)
    ax.plot(steady["record_voltage"].values / 1e3, steady["record_stretch"].values, "o",
            color=style.BLACK, markersize=3, zorder=5)  # fmt: skip
    ax.set_xlabel("voltage (kV)")
    ax.set_ylabel("steady stretch")
    ax.set_xlim(left=0.0)


def _ends(ax: Axes, ends: pd.DataFrame) -> None:
    for k, row in enumerate(ends.itertuples()):
        middle = row.pull_in_kV
        reach = np.abs([[middle - row.pull_in_q05], [row.pull_in_q95 - middle]])
        ax.errorbar(middle, k, xerr=reach, fmt=panels.marker(k), capsize=2,
                    color=panels.colour(k), elinewidth=0.9)  # fmt: skip
        ax.text(middle, k - 0.18, f"{short(row.fold_percent, 2)} % fold", ha="center",
                va="bottom", fontsize=6.0, color=style.GREY)  # fmt: skip
    panels.name_rows(ax, ends["candidate"])
    ax.set_ylim(top=-0.6)
    ax.set_xlabel("end of the near equilibrium (kV)")
