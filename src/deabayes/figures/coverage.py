"""Coverage of the predictive bands: share of points inside, against the nominal share."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from deabayes.figures import style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import ROLES

SCOPE = "candidate"
TITLE = "Coverage of the predictive bands"
CAPTION = (
    "Share of each record's points inside its 50 % and 90 % predictive bands, against the promised "
    "share (dashed). Points of one record are correlated, so a single record may well be off; all "
    "of them falling short means bands that are too narrow."
)
COLOURS = {"calibrate": style.BLUE, "validate": style.VERMILLION}


def draw(results: CandidateResults) -> list[Figure]:
    """Return two panels, 50 % and 90 %, with one row per record."""
    table = results.errors
    if table is None:
        return []
    table = table.sort_values(["role", "protocol", "experiment"])
    height = 0.15 * len(table) + 0.75 + style.HEADER
    figure = Figure(figsize=(style.DOUBLE_COLUMN, height), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, percent in zip(axes, (50, 90), strict=True):
        colours = [COLOURS[role] for role in table["role"]]
        _panel(ax, 100 * table[f"coverage_{percent}"].to_numpy(), colours, percent)
    axes[0].set_yticks(range(len(table)), table["experiment"])
    axes[0].set_ylim(len(table) - 0.5, -0.5)
    roles = [r for r in COLOURS if (table["role"] == r).any()]
    handles = [Patch(color=COLOURS[role], label=ROLES[role]) for role in roles]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return [figure]


def _panel(ax: Axes, shares: object, colours: list[str], percent: int) -> None:
    ax.scatter(shares, range(len(colours)), c=colours, s=14, zorder=3)
    ax.axvline(percent, color=style.BLACK, linestyle="--", linewidth=0.8)
    ax.set_xlim(-3, 103)
    ax.set_xlabel(f"points inside the {percent} % band (%)")
    ax.grid(axis="y", color=style.LIGHT_GREY, linewidth=0.4)
    ax.set_axisbelow(True)
