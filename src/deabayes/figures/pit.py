"""Whether each point falls where the predictive distribution, given those before it, expects it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import ROLES

SCOPE = "candidate"
TITLE = "Probability integral transforms"
CAPTION = (
    "Distribution of the probability integral transforms (PIT) of each record's n points, given "
    "those before them, less the uniform one that a right model gives. The band then holds 95 % of "
    "records (Kolmogorov-Smirnov); the farthest six that leave it are named. Above zero, then "
    "below: the predicted spread is too narrow; below, then above: too wide; on one side only: "
    "readings lie lower (above zero) or higher than predicted."
)
LIMIT = 1.36
"""5 % of uniform samples go farther, times the root of their size."""
NAMED = 6
GRID = np.linspace(0.0, 1.0, 201)


def draw(results: CandidateResults) -> list[Figure]:
    """A panel per role; the records farthest from uniform have names and colours."""
    found = {role: _departures(results, role) for role in ROLES}
    shown = {role: lines for role, lines in found.items() if lines}
    if not shown:
        return []
    rows = max(min(sum(map(_leaves, lines.values())), NAMED) for lines in shown.values())
    height = 2.1 + 0.13 * max(rows, 1) + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    reach = max(np.abs(line).max() for lines in shown.values() for line in lines.values())
    panels[0].set_ylim(np.array([-1.05, 1.05]) * max(reach, 1.5 * LIMIT))
    for ax, (role, lines) in zip(panels, shown.items(), strict=True):
        _panel(ax, lines)
        ax.set_title(ROLES[role], loc="left")
        side = "left" if ax is panels[0] else "right"
        figure.legend(*ax.get_legend_handles_labels(), loc=f"outside lower {side}")
    panels[0].set_ylabel(r"$\sqrt{n}$ (distribution of PIT − uniform)")
    return [figure]


def _departures(results: CandidateResults, role: str) -> dict[str, FloatArray]:
    """Record -> root n times its distribution's departure from uniform, on `GRID`."""
    lines = {}
    for name, prediction in results.predictions.items():
        pit = prediction.get("pit")
        if prediction.attrs["role"] != role or pit is None or not np.isfinite(pit).all():
            continue
        below = np.searchsorted(np.sort(pit.values), GRID, side="right") / pit.size
        lines[name] = np.sqrt(pit.size) * (below - GRID)
    return lines


def _leaves(departure: FloatArray) -> bool:
    return bool(np.abs(departure).max() > LIMIT)


def _panel(ax: Axes, lines: dict[str, FloatArray]) -> None:
    ax.axhspan(-LIMIT, LIMIT, color=style.LIGHT_GREY, alpha=0.5, linewidth=0)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.6)
    far = sorted(lines, key=lambda name: -np.abs(lines[name]).max())
    named = [name for name in far[:NAMED] if _leaves(lines[name])]
    others = [name for name in lines if name not in named]
    for k, name in enumerate(others):
        label = f"{len(others)} other" + ("s" if len(others) > 1 else "") if k == 0 else None
        ax.plot(GRID, lines[name], color=style.GREY, linewidth=0.6, label=label)
    for name, colour in zip(named, style.SERIES, strict=False):
        ax.plot(GRID, lines[name], color=colour, label=name)
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel("PIT")
