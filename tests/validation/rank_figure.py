"""The empirical distribution of ranks against the uniform one, with its simultaneous band."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tests.validation.ecdf import FloatArray, band, ecdf

BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#999999"
COLUMNS = 4


def draw(
    title: str, ranks: Mapping[str, Mapping[str, FloatArray]], possible: int, path: Path
) -> None:
    """One panel per parameter: ECDF of its ranks minus the uniform one.

    Parameters
    ----------
    ranks : parameter -> label of a line -> ranks (R,) of `possible` values each.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from deabayes.figures import style

    size = next(len(line) for lines in ranks.values() for line in lines.values())
    limits = band(size, possible)
    rows = -(-len(ranks) // COLUMNS)
    with style.applied():
        figure, axes = plt.subplots(
            rows,
            COLUMNS,
            figsize=(7.2, 1.6 * rows + 0.9),
            sharex=True,
            sharey=True,
            squeeze=False,
            layout="constrained",
        )
        for axis in axes.flat[len(ranks) :]:
            axis.set_visible(False)
        for axis, (name, lines) in zip(axes.flat, ranks.items(), strict=False):
            axis.fill_between(
                limits.points,
                limits.lower - limits.points,
                limits.upper - limits.points,
                color=GREY,
                alpha=0.3,
                lw=0,
                label="95 % simultaneous band",
            )
            for (label, values), colour in zip(lines.items(), (BLUE, ORANGE), strict=False):
                difference = ecdf(values, possible) - limits.points
                axis.plot(limits.points, difference, color=colour, label=label)
            axis.set_title(name.replace(".", "\n"), fontsize=8)
        for axis in axes.flat[max(len(ranks) - COLUMNS, 0) : len(ranks)]:
            axis.tick_params(labelbottom=True)
            axis.set_xlabel("rank / number of draws", fontsize=7)
        figure.supylabel("ECDF of ranks - uniform", fontsize=8)
        figure.suptitle(title, fontsize=9)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False
        )
        figure.savefig(path, dpi=160)
        plt.close(figure)
