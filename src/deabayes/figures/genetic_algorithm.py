"""Where runs of a genetic algorithm land in the posterior."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults

SCOPE = "study"
ANALYSIS = "genetic_algorithm"
TITLE = "Genetic algorithm and posterior"
KILO, MILLI, DECADE = 1e3, 1e3, 10.0
CAPTION = (
    "Left: each Ogden term's share μα/2 of the shear modulus against its exponent, draws of the "
    "posterior (points) and the optima of the genetic algorithm (a marker per run), one colour per "
    "term. Right: the rms error of the force at each optimum and the modulus μ0 its terms add up "
    "to; line and band: the posterior's μ0, dotted: the error of the posterior median. Optima "
    "far off the cloud contradict the measured stiffness of the hinges, which the algorithm does "
    "not heed and the posterior does."
)


def draw(results: StudyResults) -> list[Figure]:
    """One row per candidate."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.curves:
        return []
    rows = sorted(found.curves.values(), key=lambda each: (each["term"].size, _name(each)))
    return [_sheet(list(group)) for group in panels.batches(rows, 4)]


def _sheet(rows: list[xr.Dataset]) -> Figure:
    height = 1.75 * len(rows) + 0.6 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    axes = figure.subplots(len(rows), 2, squeeze=False, width_ratios=(5, 3))
    for (left, right), each in zip(axes, rows, strict=True):
        _terms(left, each)
        _moduli(right, each)
        mark = "" if each.attrs["converged"] else " (not converged)"
        left.set_title(_name(each) + mark, loc="left")
    axes[-1, 0].set_xlabel(r"exponent $\alpha_i$ (1)")
    axes[-1, 1].set_xlabel(r"$\mu_0$ (kPa)")
    panels.legend_below(figure, _handles(max(each["term"].size for each in rows)), 4)
    return figure


def _terms(ax: Axes, each: xr.Dataset) -> None:
    for k in range(each["term"].size):
        ax.plot(each["draw_alpha"].values[k], each["draw_share"].values[k] / KILO,
                linestyle="none", marker=".", markersize=2.5, markeredgewidth=0, alpha=0.45,
                color=style.SERIES[k], rasterized=True)  # fmt: skip
        for run in range(each["run"].size):
            ax.plot(each["run_alpha"].values[k, run], each["run_share"].values[k, run] / KILO,
                    **_marker(run, style.SERIES[k]))  # fmt: skip
    ax.set_yscale("log")
    ax.set_ylabel(r"$\mu_i\alpha_i/2$ (kPa)")


def _moduli(ax: Axes, each: xr.Dataset) -> None:
    low, middle, high = each["interval_mu_0"].values / KILO
    ax.axvspan(low, high, color=style.LIGHT_GREY, linewidth=0)
    ax.axvline(middle, color=style.GREY, linewidth=1.0)
    ax.axhline(MILLI * float(each.attrs["posterior_rms"]), color=style.GREY, linestyle=":")
    for run in range(each["run"].size):
        ax.plot(each["run_mu_0"].values[run] / KILO, MILLI * each["run_rms"].values[run],
                **_marker(run, style.VERMILLION))  # fmt: skip
    panels.logarithmic(ax, np.append(each["run_mu_0"].values, each["draw_mu_0"].values) / KILO)
    errors = MILLI * np.append(each["run_rms"].values, each.attrs["posterior_rms"])
    if errors.max() > DECADE * errors.min():
        ax.set_yscale("log")
    ax.set_ylabel("rms error of the force (mN)")


def _marker(run: int, colour: str) -> dict[str, Any]:
    return {"linestyle": "none", "marker": style.MARKERS[run % len(style.MARKERS)],
            "markersize": 4.5, "markerfacecolor": colour, "markeredgecolor": style.BLACK,
            "markeredgewidth": 0.6, "zorder": 4}  # fmt: skip


def _handles(terms: int) -> list[Line2D]:
    entries = [
        Line2D([], [], color=style.SERIES[k], marker=".", linestyle="none",
               label=f"draws, term {k + 1}")
        for k in range(terms)
    ]  # fmt: skip
    runs = Line2D([], [], **_marker(0, "white"))
    runs.set_label("optima, one marker per run")
    span = Line2D([], [], color=style.GREY, label=r"posterior $\mu_0$ (band: 5–95 %)")
    error = Line2D([], [], color=style.GREY, linestyle=":", label="error of the posterior median")
    return [*entries, runs, span, error]


def _name(each: xr.Dataset) -> str:
    return str(each.attrs["candidate"])
