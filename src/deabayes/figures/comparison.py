"""Model comparison: differences of the criteria to the reference candidate."""

from __future__ import annotations

import textwrap

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deabayes.comparison.verdicts import NOT_RANKED
from deabayes.figures import panels, style
from deabayes.figures.results import StudyResults

SCOPE = "study"
TITLE = "Which model order"
CAPTION = (
    "Differences to the reference candidate (dotted); further right is better. Bars are two "
    "standard errors: for the evidence, the Monte Carlo errors of both candidates together; for "
    "the expected log predictive density (elpd), the error of the paired difference, if it was "
    "stored. If one block holds most of a difference, its error is large, and the other blocks "
    "decide. Scales of more than 300 nats are logarithmic beyond ±10. Candidates that did not "
    "converge are named but not ranked; no experiment is left out of those far behind."
)
OF_EACH = "log_evidence_mcse"
"""Column with the error of a candidate itself; others hold the error of the difference."""
WIDE, LINEAR = 300.0, 10.0
"""Range in nats above which an axis is logarithmic, and half width of its linear part."""
CRITERIA = (
    ("log_evidence", OF_EACH, "Δ log evidence"),
    ("elpd_block_loo", "elpd_difference_se", "Δ elpd, blocks left out"),
    ("elpd_leave_one_experiment_out", None, "Δ elpd, experiments left out"),
    ("bic", None, "−½ Δ BIC"),
)

LABEL = 17
"""Characters per line of a panel's label, so that four panels fit beside long names."""
LEAST_SHOWN = 1.0
"""Nats that an axis shows at least on either side, so that it does not magnify rounding."""


def draw(results: StudyResults) -> list[Figure]:
    """Return one panel per criterion; no figure for fewer than two candidates."""
    table = results.comparison
    if table is None or len(table) < 2:
        return []
    reference = results.recommended.name
    if reference not in table.index:
        reference = str(table.index[0])
    shown = [c for c in CRITERIA if c[0] in table and np.isfinite(table.loc[reference, c[0]])]
    if not shown:
        return []
    height = 0.24 * len(table) + 0.65 + 0.13 * len(table)
    figure, (axes,) = panels.grid(1, len(shown), height, sharey=True)
    for ax, criterion in zip(axes, shown, strict=True):
        _criterion(ax, table, reference, *criterion)
    sizes = table["n_parameters"].astype(int)
    panels.name_rows(axes[0], [f"{name} ({size} par.)" for name, size in sizes.items()])
    figure.supxlabel(_verdict(table, reference), fontsize=6.5, x=0.01, ha="left")
    return [figure]


def _criterion(
    ax: Axes, table: pd.DataFrame, reference: str, column: str, error: str | None, label: str
) -> None:
    sign = -0.5 if column == "bic" else 1.0
    difference = sign * (table[column] - table.loc[reference, column])
    converged = table["converged"].astype(bool)
    width = 2.0 * _standard_error(table, reference, error)
    for row, name in enumerate(table.index):
        if not converged[name] or not np.isfinite(difference[name]):
            word = "no score" if converged[name] else "not ranked"
            ax.text(0.5, row, word, transform=ax.get_yaxis_transform(), ha="center",
                    va="center", fontsize=6, style="italic", color=style.VERMILLION,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})  # fmt: skip
            continue
        colour = style.VERMILLION if name == reference else style.BLUE
        ax.errorbar(difference[name], row, xerr=width[name] or None, fmt="o", color=colour,
                    capsize=2, elinewidth=0.8)  # fmt: skip
    shown = difference[converged].dropna()
    if not shown.empty:
        ax.axvline(0, color=style.GREY, linestyle=":", linewidth=0.8)
    if shown.empty:
        ax.set_xticks([])
    elif np.ptp(np.append(shown, 0)) > WIDE:
        ax.set_xscale("symlog", linthresh=LINEAR)
        ax.set_xticks(_three(shown))
        label += " (log. beyond ±10)"
    else:
        ax.xaxis.set_major_locator(MaxNLocator(2))
    ax.margins(x=0.12)
    if ax.get_xscale() == "linear":
        low, high = ax.get_xlim()
        ax.set_xlim(min(low, -LEAST_SHOWN), max(high, LEAST_SHOWN))
    ax.set_xlabel("\n".join(textwrap.wrap(label, LABEL)))


def _standard_error(table: pd.DataFrame, reference: str, column: str | None) -> pd.Series:
    """Standard error of each difference to the reference; zero for itself or if unknown."""
    if column not in table:
        return pd.Series(0.0, table.index)
    error = table[column].fillna(0.0).astype(float)
    if column == OF_EACH:
        error = np.hypot(error, error[reference])
    error[reference] = 0.0
    return error


def _three(shown: pd.Series) -> list[float]:
    """Ticks at zero and at the largest power of ten on each side that exceeds `LINEAR`."""
    ends = [-shown.min(), shown.max()]
    powers = [10.0 ** np.floor(np.log10(end)) if end > LINEAR else 0.0 for end in ends]
    return sorted({-powers[0], 0.0, powers[1]})


def _verdict(table: pd.DataFrame, reference: str) -> str:
    verdicts = table["verdict"].astype(str)
    text = f"{reference}: {verdicts[reference]}"
    if verdicts.str.startswith(NOT_RANKED).all():
        why = verdicts.str.removeprefix(f"{NOT_RANKED}: ")
        text = "no candidate is ranked. " + "; ".join(f"{n}: {v}" for n, v in why.items())
    return "\n".join(textwrap.wrap(text, 130))
