"""Root-mean-square error of every candidate on every record."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults

SCOPE = "study"
TITLE = "Errors, calibration and held out"
CAPTION = (
    "Root-mean-square error in per cent of each record's range. Points: of the posterior median "
    "curve; lines: 90 % interval of the errors of single draws, which mostly are larger. Only the "
    "held-out records say how well a candidate predicts. Open markers: the candidate did not "
    "converge. ✕ after a name: outside the calibrated range. The axis is logarithmic where errors "
    "differ by more than a factor of 20."
)
COLUMNS = ["e_rms_percent", "e_rms_q05", "e_rms_q95"]
ROLES = (("calibrate", "calibration records"), ("validate", "held-out records"))


def draw(results: StudyResults) -> list[Figure]:
    """Return one panel for the calibration records and one for the held-out records."""
    tables = {c.name: c.errors.set_index("experiment") for c in results.candidates
              if c.errors is not None}  # fmt: skip
    if not tables:
        return []
    roles = {n: r for t in tables.values() for n, r in t["role"].items()}
    present = [(role, text) for role, text in ROLES if role in roles.values()]
    counts = [sum(r == role for r in roles.values()) for role, _ in present]
    step = 0.10 + 0.05 * len(tables)
    height = step * sum(counts) + 0.45 * len(counts) + 0.5
    figure, axes = panels.grid(len(present), 1, height, height_ratios=counts, sharex=True)
    unconverged = {c.name for c in results.candidates if not c.converged}
    for ax, (role, text) in zip(axes[:, 0], present, strict=True):
        _panel(ax, tables, [n for n, r in roles.items() if r == role], unconverged)
        ax.set_title(text, loc="left", weight="bold")
    errors = pd.concat([table[COLUMNS] for table in tables.values()]).to_numpy(dtype=float)
    if panels.spans_much(errors[:, 0]):
        for ax in axes[:, 0]:
            panels.logarithmic(ax, errors)
    else:
        axes[0, 0].set_xlim(left=0)  # last, because it stops autoscaling to the data of all panels
    axes[-1, 0].set_xlabel("rms error (% of the record's range)")
    panels.legend_below(figure, panels.labelled(axes[0, 0]), 4)
    return [figure]


def _panel(
    ax: Axes, tables: dict[str, pd.DataFrame], experiments: list[str], unconverged: set[str]
) -> None:
    flagged: set[str] = set()
    failed: dict[int, list[str]] = {}
    for index, (candidate, table) in enumerate(tables.items()):
        rows = table.reindex(experiments)
        flagged |= {n for n, t in rows["extrapolation"].items() if isinstance(t, str) and t}
        for row, name in enumerate(experiments):
            if name in table.index and np.isnan(rows.loc[name, "e_rms_percent"]):
                failed.setdefault(row, []).append(candidate)
        place = np.arange(len(rows)) + panels.spread(index, len(tables), 0.25)
        ax.hlines(place, rows["e_rms_q05"], rows["e_rms_q95"], color=panels.colour(index),
                  linewidth=0.8)  # fmt: skip
        ax.plot(
            rows["e_rms_percent"], place, panels.marker(index), color=panels.colour(index),
            markerfacecolor="white" if candidate in unconverged else None,
            clip_on=False, in_layout=False,
            label=panels.marked(candidate, candidate not in unconverged),
        )  # fmt: skip
    for row, candidates in failed.items():
        words = panels.wrapped(f"{', '.join(candidates)}: {panels.NO_RESPONSE}", 36)
        ax.text(1.01, row, words, fontsize=6, va="center", style="italic",
                color=style.VERMILLION, transform=ax.get_yaxis_transform())  # fmt: skip
    panels.shade_rows(ax, len(experiments))
    panels.name_rows(ax, [name + (" ✕" if name in flagged else "") for name in experiments])
    panels.rule(ax, "x")
