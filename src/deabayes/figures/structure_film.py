"""What the forces tell of the film and what not: contraction and width by quantity."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults

SCOPE = "study"
ANALYSIS = "structure_film"
TITLE = "What of the film is determined"
CAPTION = (
    "Left: how much narrower the posterior is than the prior (contraction), of each parameter and, "
    "above the line, of what the whole film does. Right: half the 5 to 95 % interval over the "
    "median. Many terms pull alike with many sets of coefficients and exponents."
)
NAMES = {
    "mu_0": r"$\mu_0$",
    "hinge_stiffness": "hinge stiffness $K$",
    "blocking_force_5kV": "blocking force at 5 kV",
    "slider_stiffness": "stiffness of the slider",
    "relative_permittivity": r"$\varepsilon_r$",
}


def draw(results: StudyResults) -> list[Figure]:
    """Two panels of points, one row per quantity."""
    found = results.analysis(ANALYSIS)
    if found is None or not found.tables:
        return []
    table = found.tables["film_determined"]
    whole = table[table["of"] == "whole film"]["quantity"]
    single = table[table["of"] == "parameter"]["quantity"]
    quantities = [*dict.fromkeys(whole), *sorted(dict.fromkeys(single), key=_place)]
    figure = Figure(
        figsize=(style.DOUBLE_COLUMN, 0.22 * len(quantities) + 0.9 + style.HEADER),
        layout="constrained",
    )
    left, right = figure.subplots(1, 2, sharey=True)
    _points(left, table, quantities, "contraction_percent")
    _points(right, table, quantities, "half_width_percent")
    left.set_yticks(range(len(quantities)), [_symbol(name) for name in quantities])
    left.set_ylim(len(quantities) - 0.5, -0.5)
    left.set_xlabel("contraction (%)")
    left.set_xlim(min(-5.0, left.get_xlim()[0]), 104.0)
    right.set_xlabel("half width of the interval (% of the median)")
    panels.logarithmic(right, table["half_width_percent"].to_numpy())
    for ax in (left, right):
        ax.axhline(whole.nunique() - 0.5, color=style.GREY, linewidth=0.6)
    panels.legend_below(figure, _handles(table), 4)
    return [figure]


def _points(ax: Axes, table: pd.DataFrame, quantities: list[str], column: str) -> None:
    names = list(dict.fromkeys(table["candidate"]))
    for k, name in enumerate(names):
        own = table[table["candidate"] == name].set_index("quantity")[column]
        rows = [(i, own[q]) for i, q in enumerate(quantities) if q in own.index]
        place = np.array([i for i, _ in rows]) + panels.spread(k, len(names))
        ax.plot([value for _, value in rows], place, panels.marker(k), color=panels.colour(k),
                markersize=3.5)  # fmt: skip
    for i in range(len(quantities)):
        ax.axhline(i, color=style.LIGHT_GREY, linewidth=0.4, zorder=0)


def _handles(table: pd.DataFrame) -> list[Line2D]:
    pairs = table.drop_duplicates("candidate")[["candidate", "converged"]].to_numpy()
    return [
        Line2D([], [], color=panels.colour(k), marker=panels.marker(k), linestyle="none",
               label=f"{name}" + ("" if converged else " (not converged)"))
        for k, (name, converged) in enumerate(pairs)
    ]  # fmt: skip


def _place(quantity: str) -> tuple[int, str]:
    return ("relative_permittivity", "mu", "alpha").index(
        quantity if quantity in NAMES else quantity.partition("_")[0]
    ), quantity


def _symbol(quantity: str) -> str:
    head, _, index = quantity.partition("_")
    return NAMES.get(quantity, rf"$\{head}_{index}$")
