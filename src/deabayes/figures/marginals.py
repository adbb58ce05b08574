"""Marginal posterior and prior of each parameter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import display_unit, symbol_text

SCOPE = "candidate"
TITLE = "Parameters: posterior against prior"
CAPTION = (
    "Each parameter's posterior (filled) and prior (dashed). Where the two agree, the data said "
    "nothing and the number is the prior's."
)
COLUMNS = 4
ROWS = 5
PRIOR_TAIL = 0.005


def draw(results: CandidateResults) -> list[Figure]:
    """Return sheets of the sampled parameters, in the order of the posterior file."""
    return [_sheet(results, names) for names in panels.batches(results.sampled, COLUMNS * ROWS)]


def _sheet(results: CandidateResults, names: Sequence[str]) -> Figure:
    height = 29 * style.MILLIMETRE * -(-len(names) // COLUMNS) + 0.3
    figure, axes = panels.cells(len(names), COLUMNS, height)
    for ax, name in zip(axes, names, strict=True):
        _marginal(ax, results, name)
    handles = [
        Patch(color=style.BLUE, alpha=0.6, label="posterior"),
        panels.key("prior", style.VERMILLION, linestyle="--"),
    ]
    panels.legend_below(figure, handles)
    return figure


def _marginal(ax: Axes, results: CandidateResults, name: str) -> None:
    label = results.label(name)
    posterior = _finite(results.posterior[name].values)
    prior = _finite(results.prior[name].values) if name in results.prior else np.array([])
    unit = display_unit(label["unit"], np.median(posterior), name)
    posterior, prior = posterior / unit.factor, prior / unit.factor
    low, high, log = _window(posterior, prior)
    edges = np.geomspace(low, high, 50) if log else np.linspace(low, high, 50)
    heights = np.histogram(posterior, edges)[0] / np.diff(np.log(edges) if log else edges)
    ax.stairs(heights / posterior.size, edges, fill=True, color=style.BLUE, alpha=0.6)
    if prior.size:
        x, density = _smooth(prior, low, high, log)
        ax.plot(x, density, color=style.VERMILLION, linestyle="--")
    if log:
        panels.logarithmic(ax, np.array([low, high]), 4)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.set_xlim(low, high)
    ax.set_ylim(bottom=0)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel(symbol_text(name, label["symbol"]) + unit.suffix)


def _finite(values: FloatArray) -> FloatArray:
    values = np.asarray(values, dtype=float).ravel()
    return values[np.isfinite(values)]


def _window(posterior: FloatArray, prior: FloatArray) -> tuple[float, float, bool]:
    """Limits of the axis, and whether it is logarithmic.

    The limits show posterior and prior. If the prior is much wider, they follow the posterior.
    """
    low, high = np.quantile(posterior, [0.001, 0.999])
    if not prior.size:
        return float(low), float(high), False
    wide = np.quantile(prior, [PRIOR_TAIL, 1 - PRIOR_TAIL])
    log = bool(posterior.min() > 0 and prior.min() > 0 and wide[1] > 20 * wide[0])
    inner, outer = np.array([low, high]), wide
    if log:
        inner, outer = np.log(inner), np.log(outer)
    limits = np.array([min(inner[0], outer[0]), max(inner[1], outer[1])])
    if np.ptp(limits) > 15 * np.ptp(inner):
        margin = 2 * np.ptp(inner)
        limits = np.clip([inner[0] - margin, inner[1] + margin], *limits)
    first, last = (np.exp(limits) if log else limits).tolist()
    return first, last, log


def _smooth(
    values: FloatArray, low: float, high: float, log: bool
) -> tuple[FloatArray, FloatArray]:
    """Normal kernel density estimate with Scott's bandwidth, at 200 points."""
    if np.ptp(values) == 0:
        return np.array([]), np.array([])
    x = np.geomspace(low, high, 200) if log else np.linspace(low, high, 200)
    centres, places = (np.log(each) if log else each for each in (values, x))
    width = centres.std(ddof=1) * centres.size**-0.2
    heights = np.exp(-0.5 * ((places[:, None] - centres) / width) ** 2).mean(axis=1)
    density = heights / (width * np.sqrt(2.0 * np.pi))
    inside = (x >= values.min()) & (x <= values.max())
    return x, np.where(inside, density, 0.0)
