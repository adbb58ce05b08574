"""Probability integral transform (PIT) of each point, given the points before it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import ROLES

SCOPE = "candidate"
TITLE = "Probability integral transforms"
CAPTION = (
    "Distribution of the probability integral transforms (PIT) of each record's n points, given "
    "the points before them, minus the uniform distribution of a right model. The unit is the "
    "distance that 5 % of right models exceed with n points (Kolmogorov-Smirnov): the band ends "
    "there, where p is 0.05. Of the records that leave it, the farthest six are named. Above zero, "
    "then below: the predicted spread is too narrow; below, then above: too wide; on one side "
    "only: readings lie lower (above zero) or higher than predicted."
)
LEVEL = 0.05
"""Share of uniform samples that leave the band; the tables use the same limit."""
NAMED = 6
Line = tuple[FloatArray, FloatArray]


def draw(results: CandidateResults) -> list[Figure]:
    """Return one panel per role; the records farthest from uniform have names and colours."""
    by_role = {role: _departures(results, role) for role in ROLES}
    shown = {role: lines for role, lines in by_role.items() if lines}
    if not shown:
        return []
    rows = sum(min(sum(map(_leaves, lines.values())), NAMED) for lines in shown.values())
    figure, (axes,) = panels.grid(1, len(shown), 2.1 + 0.13 * max(rows, 1), sharey=True)
    reach = max(_reach(line) for lines in shown.values() for line in lines.values())
    axes[0].set_ylim(np.array([-1.05, 1.05]) * max(reach, 1.5))
    for k, (ax, (role, lines)) in enumerate(zip(axes, shown.items(), strict=True)):
        _panel(ax, lines, panels.line(k))
        ax.set_title(ROLES[role], loc="left")
    axes[0].set_ylabel("departure from uniform\n(1: the 5 % limit)")
    panels.legend_below(figure, panels.labelled(*axes), 3)
    return [figure]


def _departures(results: CandidateResults, role: str) -> dict[str, Line]:
    """PIT of each record and its departure from uniform, in units of the 5 % limit.

    Each PIT value has two departures: just below the value and at the value.
    """
    from scipy.special import smirnovi

    lines = {}
    for name, prediction in results.predictions.items():
        pit = prediction.get("pit")
        if prediction.attrs["role"] != role or pit is None or not np.isfinite(pit).all():
            continue
        steps = np.repeat(np.arange(pit.size + 1), 2)[1:-1] / pit.size
        places = np.repeat(np.sort(pit.values), 2)
        departure = (steps - places) / smirnovi(pit.size, LEVEL / 2.0)
        lines[name] = np.r_[0.0, places, 1.0], np.r_[0.0, departure, 0.0]
    return lines


def _reach(line: Line) -> float:
    return float(np.abs(line[1]).max())


def _leaves(line: Line) -> bool:
    return _reach(line) > 1.0


def _panel(ax: Axes, lines: dict[str, Line], style_of_line: str) -> None:
    ax.axhspan(-1.0, 1.0, color=style.LIGHT_GREY, alpha=0.5, linewidth=0)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    far = sorted(lines, key=lambda name: -_reach(lines[name]))
    named = [name for name in far[:NAMED] if _leaves(lines[name])]
    others = [name for name in lines if name not in named]
    for name in others:
        _plot(ax, lines[name], color=style.GREY, linewidth=0.6, label="others")
    for name, colour in zip(named, style.SERIES, strict=False):
        _plot(ax, lines[name], color=colour, linestyle=style_of_line, label=name)
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel("PIT")


def _plot(ax: Axes, line: Line, **settings: Any) -> None:
    """Draw one record's line; many points are rasterized to keep vector files small."""
    ax.plot(*line, rasterized=line[0].size > panels.DENSE, **settings)
