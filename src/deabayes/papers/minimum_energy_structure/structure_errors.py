"""Table 5 of the minimum-energy structure's paper: e_rms by frequency and voltage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import AnalysisResults, StudyResults
from deabayes.papers import minimum_energy_structure as paper
from deabayes.papers.base import Analysis, Row, StudyContext, beside, error_interval
from deabayes.papers.timing import Cycles
from deabayes.prediction.errors import relative_rms_error

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


def compute(context: StudyContext) -> Analysis:
    """Return one row per candidate and frequency, with the voltages side by side."""
    rows = [
        first
        | {"frequency_Hz": round(Cycles.of(record).frequency, 3)}
        | {"voltage_kV": paper.kilovolts(record)}
        | errors(record, curves)
        for first, record, curves in context.predicted(context.records("displacement", "sine"))
    ]
    return Analysis.of_rows({"table_5_errors": beside(rows)})


def errors(experiment: Experiment, curves: FloatArray) -> Row:
    """e_rms of the whole record and of its second half in time, and the value of the paper."""
    time = experiment.coordinate
    late = time > 0.5 * (experiment.excitation.onset + time[-1])
    hertz = Cycles.of(experiment).frequency
    return {
        "role": experiment.role,
        **_e_rms("e_rms", experiment, curves, np.ones_like(late)),
        **_e_rms("e_rms_late", experiment, curves, late),
        "paper_e_rms_percent": paper.e_rms(paper.kilovolts(experiment), hertz),
    }


def _e_rms(
    name: str, experiment: Experiment, curves: FloatArray, part: NDArray[np.bool_]
) -> dict[str, float]:
    y = experiment.response[part]
    scale = PERCENT * np.ptp(y) / experiment.response_range
    return error_interval(name, curves[:, part], lambda c: scale * relative_rms_error(y, c))


def draw(results: StudyResults, analysis: AnalysisResults) -> list[Figure]:
    """Return one panel per voltage."""
    table = analysis.tables["table_5_errors"]
    voltages = [c.removeprefix("role_") for c in table.columns if str(c).startswith("role_")]
    figure, (axes,) = panels.grid(1, len(voltages), 2.5, sharey=True)
    for ax, voltage in zip(axes, voltages, strict=True):
        _panel(ax, table, voltage)
    if panels.spans_much(table.filter(regex=POINTS).to_numpy(dtype=float)):
        panels.logarithmic(axes[0], table.filter(regex=ERRORS).to_numpy(dtype=float), which="y")
    else:
        axes[0].set_ylim(bottom=0.0)
    axes[0].set_ylabel("$e_\\mathrm{rms}$ (% of range)")
    printed = panels.key("paper, Table 5", marker="x")
    entries = [*panels.candidate_handles(table), *panels.role_handles(style.GREY), printed]
    panels.legend_below(figure, entries, 4)
    return [figure]


def _panel(ax: Axes, table: pd.DataFrame, voltage: str) -> None:
    beyond: dict[str, Any] = {"clip_on": False, "in_layout": False}
    groups = table.groupby("candidate", sort=False)
    for k, (_, own) in enumerate(groups):
        place = own["frequency_Hz"].to_numpy() + 0.8 * panels.spread(k, len(groups))
        value, low, high = (own[f"e_rms_{voltage}_{end}"] for end in ("percent", "q05", "q95"))
        ax.vlines(place, low, high, color=panels.colour(k), linewidth=0.9)
        calibrated = (own[f"role_{voltage}"] == "calibrate").to_numpy()
        points = {"marker": panels.marker(k), "color": panels.colour(k), **beyond}
        panels.draw_by_role(ax, place, value.to_numpy(), calibrated, **points)
    printed = table.drop_duplicates("frequency_Hz")
    ax.plot(printed["frequency_Hz"], printed[f"paper_e_rms_{voltage}_percent"], "x",
            color=style.BLACK, markersize=4, **beyond)  # fmt: skip
    ax.set_xlabel("frequency (Hz)")
    ax.set_xticks(sorted(np.unique(table["frequency_Hz"].round().astype(int))))
    ax.set_title(voltage.replace("kV", " kV"), loc="left")
