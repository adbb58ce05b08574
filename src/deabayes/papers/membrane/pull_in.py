"""Voltage at which a membrane's near equilibrium ends, and steady stretch below it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers import membrane as paper
from deabayes.papers.base import Analysis, StudyContext, band, interval, labels
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


def compute(context: StudyContext) -> Analysis:
    """Return pull-in and steady stretch per candidate, and steady stretch against voltage."""
    ends, steady = [], []
    for name, fitted in context.candidates.items():
        found = membrane(fitted).pull_in(fitted.draws)
        ends.append(
            labels(name, fitted) | interval("pull_in", "kV", found.voltage / 1e3)
            | interval("stretch_there", "", found.stretch)
            | {"fold_percent": 100.0 * float(np.mean(found.fold))}
        )  # fmt: skip
        steady += [labels(name, fitted) | steady_row(fitted, kilovolt) for kilovolt in VOLTAGES]
    tables = {"pull_in": pd.DataFrame(ends), "steady_stretch": pd.DataFrame(steady)}
    return Analysis(tables, {"steady_stretch": steady_curves(context)})


def membrane(fitted: Fitted) -> Membrane:
    """Return the forward model of a candidate, which must be a membrane."""
    from deabayes.systems.membrane.system import Membrane

    assert isinstance(fitted.system, Membrane)
    return fitted.system


def steady_row(fitted: Fitted, kilovolt: float) -> dict[str, object]:
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
    highest = max([amplitude(each.excitation) for each in records], default=4e3)
    grid = np.linspace(0.0, BEYOND * highest, POINTS)
    names = list(context.candidates)
    found = [steady_band(context.candidates[name], grid) for name in names]
    size, rest = (context.specimen.quantities[n].value for n in ("side_length", "prestretch"))
    last = [rest + float(each.response[-1]) / size for each in records]
    return xr.Dataset(
        {
            "stretch": (("candidate", "bound", "voltage"), np.array([b for b, _ in found])),
            "share": (("candidate", "voltage"), np.array([s for _, s in found])),
            "record_stretch": ("record", np.array(last)),
            "record_voltage": (
                "record", np.array([amplitude(each.excitation) for each in records])
            ),
            "record_duration": ("record", np.array([since_step(each)[-1] for each in records])),
        },
        coords={
            "candidate": names,
            "converged": ("candidate", [int(context.candidates[n].converged) for n in names]),
            "bound": ["lower", "median", "upper"],
            "voltage": ("voltage", grid, {"units": "V"}),
            "record": [each.name for each in records],
        },
    )  # fmt: skip


def steady_band(fitted: Fitted, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Band (3, V) of the steady stretch and share (V,) of the draws that have one."""
    stretch = np.array([membrane(fitted).steady_stretch(fitted.draws, volts) for volts in grid])
    there = np.isfinite(stretch)
    bands = np.full((3, grid.size), np.nan)
    for k in np.flatnonzero(there.any(axis=1)):
        bands[:, k] = band(stretch[k, there[k], None])[:, 0]
    return bands, there.mean(axis=1)


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


def draw(results: StudyResults) -> list[Figure]:
    """Return two panels: steady stretch against voltage, and end of the near equilibrium."""
    found = results.analysis(ANALYSIS)
    if found is None:
        return []
    steady, ends = found.curves["steady_stretch"], found.tables["pull_in"]
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 2.5 + style.HEADER), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _steady(left, steady)
    _ends(right, ends, float(steady["record_voltage"].max()) / 1e3 if steady["record"].size else 0)
    entries = panels.handles(steady, measured=False)
    if steady["record"].size:
        last = short(float(steady["record_duration"].max()), 3)
        entries.insert(
            0,
            Line2D(
                [], [], color=style.BLACK, marker="o", markersize=3, linestyle="none",
                label=f"record at its end, {last} s",
            ),
        )  # fmt: skip
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


def _ends(ax: Axes, ends: pd.DataFrame, highest: float) -> None:
    for k, (_, row) in enumerate(ends.iterrows()):
        reach = [[row["pull_in_kV"] - row["pull_in_q05"]], [row["pull_in_q95"] - row["pull_in_kV"]]]
        ax.errorbar(row["pull_in_kV"], k, xerr=np.abs(reach), fmt=panels.marker(k), capsize=2,
                    color=panels.colour(k), elinewidth=0.9)  # fmt: skip
        ax.text(row["pull_in_kV"], k - 0.18, f"{short(row['fold_percent'], 2)} % fold",
                ha="center", va="bottom", fontsize=6.0, color=style.GREY)  # fmt: skip
    if highest:
        ax.axvline(highest, color=style.GREY, linestyle=":", linewidth=0.8)
    ax.set_yticks(range(len(ends)), ends["candidate"])
    ax.set_ylim(len(ends) - 0.5, -0.6)
    ax.set_xlabel("end of the near equilibrium (kV)")
