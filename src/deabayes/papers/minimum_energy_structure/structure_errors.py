"""Table 5 of the minimum-energy structure's paper: e_rms by frequency and voltage."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, StudyContext, beside, interval, labels
from deabayes.papers.timing import Cycles
from deabayes.prediction.errors import relative_rms_error
from deabayes.quantities import ROLES

SYSTEMS = ("minimum_energy_structure",)
TITLE = "Errors of the sines (Table 5)"
PERCENT = 100.0
CAPTION = (
    "e_rms (26) in per cent of the record's range: of the posterior median curve, with the 5 to "
    "95 % interval of the draws' own. The whole record as prepared, where the cycles of the "
    "transition weigh more than in the raw samples, and the second half of its time alone, where "
    "the response is stable. Role: whether the record was fitted. The paper's figures were found "
    "on its own specimen; it tuned on 1, 5 and 10 Hz at 5 kV, as is fitted here."
)


def compute(context: StudyContext) -> Analysis:
    """Return one row per candidate and frequency, with the voltages side by side."""
    records = context.records("displacement", "sine")
    rows = [
        labels(name, fitted)
        | {"frequency_Hz": round(Cycles.of(each).frequency, 3)}
        | {"voltage_kV": paper.kilovolts(each)}
        | errors(each, context.responses(name, each))
        for name, fitted in context.candidates.items()
        for each in records
    ]
    return Analysis({"table_5_errors": pd.DataFrame(beside(rows, "kV"))} if rows else {})


def errors(experiment: Experiment, curves: FloatArray) -> dict[str, object]:
    """e_rms of the whole record and of its second half in time, and the value of the paper."""
    start = experiment.excitation.onset
    late = experiment.coordinate > 0.5 * (start + experiment.coordinate[-1])
    found: dict[str, object] = {"role": experiment.role}
    for name, part in (("e_rms", np.ones_like(late)), ("e_rms_late", late)):
        found |= _e_rms(name, experiment, curves, part)
    printed = paper.e_rms(paper.kilovolts(experiment), Cycles.of(experiment).frequency)
    return found | {"paper_e_rms_percent": printed}


def _e_rms(
    name: str, experiment: Experiment, curves: FloatArray, part: NDArray[np.bool_]
) -> dict[str, float]:
    observed, middle = experiment.response[part], np.median(curves, axis=0)[part]
    scale = PERCENT * np.ptp(observed) / experiment.response_range
    of_draws = scale * relative_rms_error(observed, curves[:, part])
    return interval(name, "percent", of_draws, scale * float(relative_rms_error(observed, middle)))


SCOPE = "study"
ANALYSIS = "structure_errors"
FIGURE_TITLE = "Errors of the sines"
FIGURE_CAPTION = (
    "e_rms of each sine as prepared, in per cent of its range: of the posterior median curve, with "
    "the interval of the draws' own errors; filled points were fitted, open ones held out. "
    "Crosses: the paper's Table 5, found on its own specimen. The axis is logarithmic where errors "
    "differ by more than a factor of 20."
)

POINTS = r"e_rms_.*_percent$"
ERRORS = r"e_rms_.*_(percent|q05|q95)$"


def draw(results: StudyResults) -> list[Figure]:
    """Return one panel per voltage."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.tables:
        return []
    table = found.tables["table_5_errors"]
    voltages = [c.removeprefix("role_") for c in table.columns if str(c).startswith("role_")]
    figure = Figure(figsize=(style.DOUBLE_COLUMN, 2.5 + style.HEADER), layout="constrained")
    axes = figure.subplots(1, len(voltages), sharey=True, squeeze=False)[0]
    for ax, voltage in zip(axes, voltages, strict=True):
        _panel(ax, table, voltage)
    errors = table.filter(regex=ERRORS).to_numpy(dtype=float)
    if panels.spans_much(table.filter(regex=POINTS).to_numpy(dtype=float)):
        panels.logarithmic(axes[0], errors, which="y")
    else:
        axes[0].set_ylim(bottom=0.0)
    axes[0].set_ylabel("$e_\\mathrm{rms}$ (% of range)")
    panels.legend_below(figure, _handles(table), 4)
    return [figure]


def _panel(ax: Axes, table: pd.DataFrame, voltage: str) -> None:
    names = list(dict.fromkeys(table["candidate"]))
    for k, name in enumerate(names):
        own = table[table["candidate"] == name]
        place = own["frequency_Hz"].to_numpy() + 0.8 * panels.spread(k, len(names))
        value = own[f"e_rms_{voltage}_percent"].to_numpy()
        ends = own[f"e_rms_{voltage}_q05"].to_numpy(), own[f"e_rms_{voltage}_q95"].to_numpy()
        ax.vlines(place, *ends, color=panels.colour(k), linewidth=0.9)
        fitted = (own[f"role_{voltage}"] == "calibrate").to_numpy()
        for part, fill in ((fitted, panels.colour(k)), (~fitted, "white")):
            ax.plot(place[part], value[part], linestyle="none", marker=panels.marker(k),
                    color=panels.colour(k), markerfacecolor=fill, markersize=3.5,
                    clip_on=False, in_layout=False)  # fmt: skip
    printed = table.drop_duplicates("frequency_Hz")
    ax.plot(printed["frequency_Hz"], printed[f"paper_e_rms_{voltage}_percent"], "x",
            color=style.BLACK, markersize=4, clip_on=False, in_layout=False)  # fmt: skip
    ax.set_xlabel("frequency (Hz)")
    ax.set_xticks(sorted(np.unique(table["frequency_Hz"].round().astype(int))))
    ax.set_title(voltage.replace("kV", " kV"), loc="left")


def _handles(table: pd.DataFrame) -> list[Line2D]:
    pairs = table.drop_duplicates("candidate")[["candidate", "converged"]].to_numpy()
    entries = [
        Line2D([], [], color=panels.colour(k), marker=panels.marker(k), linestyle="none",
               label=f"{name}" + ("" if converged else " (not converged)"))
        for k, (name, converged) in enumerate(pairs)
    ]  # fmt: skip
    roles = [
        Line2D([], [], color=style.GREY, marker="o", linestyle="none", markerfacecolor=fill,
               label=ROLES[role])
        for role, fill in (("calibrate", style.GREY), ("validate", "white"))
    ]  # fmt: skip
    paper = Line2D([], [], color=style.BLACK, marker="x", linestyle="none", label="paper, Table 5")
    return [*entries, *roles, paper]
