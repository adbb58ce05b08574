"""Agreement of independent runs: gates of every quantity, traces and ranks of the worst."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import display_unit, symbol_text

SCOPE = "candidate"
TITLE = "Convergence"
CAPTION = (
    "R-hat, effective sample sizes and the lengths of the runs in autocorrelation times, with the "
    "limits they must keep (dashed; red: not kept), then the quantities with the largest R-hat: "
    "one colour per independent run. Runs that agree have traces that overlie each other and flat "
    "rank counts. Posterior files that keep no lengths show those of runs that are too short."
)
WORST = 6
TRACE_POINTS = 250
RANK_BINS = 20


def draw(results: CandidateResults) -> list[Figure]:
    """Return a sheet of gates for all quantities, and one of traces and ranks of the worst."""
    table = results.summary
    if table is None:
        return []
    names = [n for n in table.index if n in results.posterior and np.ptp(_runs(results, n)) > 0]
    worst = table.loc[names].sort_values("r_hat", ascending=False).index[:WORST]
    return [_gates(results, table.loc[names]), _traces(results, list(worst))]


def _runs(results: CandidateResults, name: str) -> FloatArray:
    """Draws (run, draw) of a quantity."""
    return np.asarray(results.posterior[name].transpose("chain", "draw").values, dtype=float)


def _gates(results: CandidateResults, table: pd.DataFrame) -> Figure:
    height = 0.135 * len(table) + 0.9
    figure, ((left, right, runs),) = panels.grid(1, 3, height, width_ratios=(1, 1, 0.6))
    rows = np.arange(len(table))
    r_hat, ess = results.gate("r_hat", 1.01), results.gate("ess", 400.0)
    left.scatter(table["r_hat"], rows, c=_colours(table["r_hat"] < r_hat), s=9)
    panels.mark_limit(left, r_hat)
    left.set_xlabel(f"R-hat (limit {r_hat:g}; red: not kept)")
    left.set_xlim(min(0.998, table["r_hat"].min() - 0.001))
    for column, marker, text in (("ess_bulk", "o", "bulk"), ("ess_tail", "^", "tails")):
        colours = _colours(table[column] >= ess)
        right.scatter(table[column], rows, c=colours, s=9, marker=marker)
        right.scatter([], [], c=style.BLUE, s=9, marker=marker, label=text)
    panels.mark_limit(right, ess)
    sizes = table[["ess_bulk", "ess_tail"]].to_numpy(dtype=float)
    panels.logarithmic(right, np.append(sizes[np.isfinite(sizes)], ess))
    right.set_xlabel(f"effective sample size (limit {ess:g})")
    figure.legend(loc="outside lower right", ncols=2)
    panels.name_rows(left, [_name(results, name) for name in table.index], fontsize=6.0)
    right.set_yticks(rows, [])
    right.set_ylim(left.get_ylim())
    _lengths(runs, results)
    for ax in (left, right, runs):
        panels.rule(ax)
    return figure


def _colours(passed: pd.Series) -> NDArray[np.str_]:
    return np.where(passed, style.BLUE, style.VERMILLION)


def _lengths(ax: Axes, results: CandidateResults) -> None:
    """Draw each run's length in autocorrelation times, in red if the runs are too short."""
    limit = results.gate("autocorrelation_times", 10.0)
    lengths = np.array(results.convergence["autocorrelation_times"], dtype=float)
    rows = np.arange(lengths.size)
    long_enough = results.convergence["length"] >= limit
    ax.scatter(lengths, rows, c=style.BLUE if long_enough else style.VERMILLION, s=9)
    panels.mark_limit(ax, limit)
    if panels.spans_much(np.append(lengths, limit)):
        panels.logarithmic(ax, np.append(lengths, limit), ticks=3)
    else:
        # keep the marker of the longest run away from the end of the axis
        ax.set_xlim(0.0, 1.1 * np.append(lengths, limit).max())
    ax.set_yticks(rows, [f"run {k + 1}" for k in rows], fontsize=6.0)
    ax.set_ylim(max(lengths.size, 1) - 0.5, -0.5)
    ax.set_xlabel(f"run in autocorrelation times\n(on average at least {limit:g})")


def _name(results: CandidateResults, name: str) -> str:
    return symbol_text(name, results.label(name)["symbol"])


def _traces(results: CandidateResults, names: list[str]) -> Figure:
    height = 26 * style.MILLIMETRE * len(names) + 0.45
    figure, axes = panels.grid(len(names), 2, height, width_ratios=(2, 1), sharex="col")
    for (trace, rank), name in zip(axes, names, strict=True):
        runs = _runs(results, name)
        unit = display_unit(results.label(name)["unit"], np.nanmedian(runs), name)
        _trace(trace, runs / unit.factor)
        trace.set_ylabel(_name(results, name) + unit.suffix)
        _ranks(rank, runs)
    axes[-1, 0].set_xlabel("draw (kept, thinned)")
    axes[-1, 1].set_xlabel("rank among all draws")
    count = results.posterior.sizes["chain"]
    handles = [panels.key(f"run {k + 1}", panels.colour(k)) for k in range(count)]
    figure.legend(handles=handles, loc="outside lower center", ncols=8)
    return figure


def _trace(ax: Axes, runs: FloatArray) -> None:
    step = max(runs.shape[1] // TRACE_POINTS, 1)
    for index, values in enumerate(runs):
        ax.plot(np.arange(values.size)[::step], values[::step], linewidth=0.4, alpha=0.8,
                color=panels.colour(index))  # fmt: skip


def _ranks(ax: Axes, runs: FloatArray) -> None:
    """Draw rank counts per run, relative to the count expected if all runs agree."""
    from scipy.stats import rankdata

    for values in rankdata(runs).reshape(runs.shape) / runs.size:
        counts, edges = np.histogram(values, RANK_BINS, range=(0, 1))
        ax.stairs(counts * RANK_BINS / values.size, edges, linewidth=0.9)
    ax.axhline(1.0, color=style.BLACK, linewidth=0.6, linestyle="--")
    ax.set_ylim(0, max(2.0, ax.get_ylim()[1]))
    ax.set_ylabel("count / expected")
