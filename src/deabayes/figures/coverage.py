"""Coverage of the predictive bands: share of points inside, against the nominal share."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.patches import Patch

from deabayes.figures import panels, style
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
    figure, ((left, right),) = panels.grid(1, 2, 0.15 * len(table) + 0.75, sharey=True)
    for ax, percent in ((left, 50), (right, 90)):
        shares, colours = 100 * table[f"coverage_{percent}"], table["role"].map(COLOURS)
        ax.scatter(shares, range(len(table)), c=colours, s=14, zorder=3)
        panels.mark_limit(ax, percent)
        ax.set_xlim(-3, 103)
        ax.set_xlabel(f"points inside the {percent} % band (%)")
        panels.rule(ax)
    panels.name_rows(left, table["experiment"])
    roles = [role for role in COLOURS if (table["role"] == role).any()]
    handles = [Patch(color=COLOURS[role], label=ROLES[role]) for role in roles]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return [figure]
