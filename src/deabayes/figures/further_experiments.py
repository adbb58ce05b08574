"""Expected information of further experiments about candidates and parameters."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults

SCOPE = "study"
TITLE = "Which further experiment"
CAPTION = (
    "What an experiment is expected to tell, from the posteriors, with two standard errors of the "
    "Monte Carlo. Where several candidates are still in the running, left: probability that its "
    "data name the right one (dotted: by guessing); middle: the same as information, at most the "
    "logarithm of their number (dashed). Right, or alone: information about each candidate's "
    "parameters, its noise left out. Filled: new experiments, open: held-out records. ✕ after a "
    "name: outside the calibrated range; ▲: some draws have no response, so that the specimen may "
    "not survive it."
)
MOST_SHOWN = 24


def draw(results: StudyResults) -> list[Figure]:
    """Return one row per experiment, most informative on top; no figure if there is no table."""
    table = results.further_experiments
    if table is None:
        return []
    table = table.head(MOST_SHOWN)
    candidates = str(table["candidates"].iloc[0]).split(", ")
    several = len(candidates) > 1
    figure, (axes,) = panels.grid(
        1, 3 if several else 1, 0.2 * len(table) + 0.75, sharey=True
    )  # fmt: skip
    if several:
        _told_apart(axes[0], axes[1], table, len(candidates))
    _parameters(axes[-1], table, candidates)
    panels.name_rows(axes[0], [_name(row) for _, row in table.iterrows()])
    for ax in axes:
        panels.shade_rows(ax, len(table))
    if several:
        figure.legend(*axes[-1].get_legend_handles_labels(), loc="outside lower right", ncols=4)
    return [figure]


def _told_apart(left: Axes, right: Axes, table: pd.DataFrame, count: int) -> None:
    """Draw the probability of naming the right candidate, and the information about it."""
    left.axvline(1.0 / count, color=style.GREY, linestyle=":", linewidth=0.8)
    right.axvline(np.log(count), color=style.GREY, linestyle="--", linewidth=0.8)
    _dots(left, table, "probability_right", "probability_right_error")
    _dots(right, table, "information_candidate_nats", "information_candidate_error_nats")
    left.set_xlim(1.0 / count - 0.05, 1.02)
    left.set_xlabel("probability of deciding rightly")
    right.set_xlim(-0.03 * np.log(count), 1.05 * np.log(count))
    right.set_xlabel("about the candidate (nats)")


def _parameters(ax: Axes, table: pd.DataFrame, candidates: list[str]) -> None:
    """Draw the information about the parameters of each candidate."""
    for index, candidate in enumerate(candidates):
        offset, name = panels.spread(index, len(candidates), 0.2), f"information_{candidate}"
        # blue circles are the information about the candidate
        point = {"color": panels.colour(index + 1),
                 "marker": style.MARKERS[(index + 1) % len(style.MARKERS)]}  # fmt: skip
        _dots(ax, table, f"{name}_nats", f"{name}_error_nats", offset, **point)
        ax.plot([], [], linestyle="none", label=candidate, **point)
    ax.set_xlim(left=0.0)
    owner = f"parameters of {candidates[0]}" if len(candidates) == 1 else "each one's parameters"
    ax.set_xlabel(f"about {owner} (nats)")


def _dots(
    ax: Axes,
    table: pd.DataFrame,
    column: str,
    error: str,
    offset: float = 0.0,
    color: str = style.BLUE,
    marker: str = "o",
) -> None:
    for row, (_, values) in enumerate(table.iterrows()):
        ax.errorbar(
            values[column], row + offset, xerr=2.0 * values[error], color=color, elinewidth=0.8,
            fmt=marker, markeredgecolor=color,
            markerfacecolor="white" if values["held_out"] else color,
        )  # fmt: skip


def _name(row: pd.Series) -> str:
    flag = row["extrapolation"]
    outside = " ✕" if isinstance(flag, str) and flag else ""
    return str(row["experiment"]) + outside + (" ▲" if row["failed_share"] > 0.0 else "")
