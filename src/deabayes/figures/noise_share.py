"""Share of each record's variance that the noise model explains instead of the physics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deabayes.experiment import FloatArray
from deabayes.figures import panels, style
from deabayes.figures.results import CandidateResults
from deabayes.quantities import DisplayUnit, display_unit, plain

SCOPE = "candidate"
TITLE = "What the noise model took"
CAPTION = (
    "Left: share of each calibration record's variance that the correlated noise and the white "
    "noise of its points stand for (median, 90 % interval). Right: the noise's correlation time, "
    "or length along the coordinate of a record without time or in points of its grid, against the "
    "record's length; where records differ in coordinate, as a share of it. A large share with a "
    "long time is physics that the candidate lacks; the report warns of correlated noise that "
    "stands for more than 10 % (dashed)."
)
ALARMING = 0.1


def draw(results: CandidateResults) -> list[Figure]:
    """Return one row per calibration record."""
    shares = correlated_shares(results)
    if not shares:
        return []
    height = 0.17 * len(shares) + 0.75
    figure, ((left, right),) = panels.grid(1, 2, height, sharey=True, width_ratios=(3, 2))
    units, label = _coordinates(results, list(shares))
    for row, name in enumerate(shares):
        _shares(left, row, shares[name])
        _times(right, row, results, name, units[name])
    panels.mark_limit(left, 100 * ALARMING)
    left.set_xscale("log")
    left.set_xlabel("share of the record's variance (%)")
    right.set_xscale("log")
    panels.logarithmic(right, np.array(right.get_xlim()))
    right.set_xlabel(label)
    panels.name_rows(left, list(shares))
    panels.legend_below(figure, panels.labelled(left, right), 4)
    return [figure]


def correlated_shares(results: CandidateResults) -> dict[str, Mapping[str, FloatArray]]:
    """Shares (low, median, high) of each record's variance, by kind: `correlated`, `white`."""
    return {
        name: {kind: _quantiles(each / observed.var()) for kind, each in variances.items()}
        for name, observed, variances in _explained(results)
    }


def sizes(results: CandidateResults) -> dict[str, Mapping[str, float]]:
    """Noise standard deviations over each record's range, by kind: `correlated`, `white`."""
    return {
        name: {
            kind: float(np.sqrt(_quantiles(each)[1]) / np.ptp(observed))
            for kind, each in variances.items()
        }
        for name, observed, variances in _explained(results)
    }


def _explained(
    results: CandidateResults,
) -> Iterator[tuple[str, FloatArray, Mapping[str, FloatArray]]]:
    """Yield name, response and noise variances (S,) of each calibration record.

    The response is its logarithm if the noise is proportional. Kinds of noise without variance
    are left out.
    """
    for name, prediction in results.predictions.items():
        if prediction.attrs["role"] != "calibrate":
            continue
        record, observed = results.records.get(name, {}), prediction["observed"].values
        relative = results.settings.get("noise_scale") == "range"
        scale = float(record.get("scale", np.ptp(observed) if relative else 1.0))
        draws = results.noise.for_record(
            results.noise_draws(name), float(record.get("correlated_scale", 1.0))
        )
        if record.get("proportional", False):
            observed = np.log(observed)
        weights = 1.0 / results.study.experiments[name].samples_averaged
        variances = results.noise.variances(draws, weights)
        named = dict(zip(("correlated", "white"), variances, strict=True))
        present = {kind: each * scale**2 for kind, each in named.items() if np.any(each > 0.0)}
        yield name, observed, present


def _along_grid(results: CandidateResults) -> bool:
    """Whether noise is correlated along the index of the points instead of the coordinate."""
    return results.settings.get("noise_coordinate") == "grid"


def _quantiles(values: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore"):  # variances may be infinite
        return np.nanquantile(values, [0.05, 0.5, 0.95])


def _shares(ax: Axes, row: int, shares: Mapping[str, FloatArray]) -> None:
    for kind, colour, shift in (("correlated", style.ORANGE, -0.12), ("white", style.GREY, 0.12)):
        if kind in shares:
            ends = 100 * np.maximum(shares[kind], 1e-9)
            _interval(ax, ends, row + shift, fmt="o", color=colour, label=f"{kind} noise")


def _coordinates(results: CandidateResults, names: list[str]) -> tuple[dict[str, float], str]:
    """Divisor of each record's coordinate, and the label of the axis."""
    if _along_grid(results):
        return dict.fromkeys(names, 1.0), "points of the grid"
    axes = {name: results.predictions[name]["coordinate"] for name in names}
    spans = {name: float(np.ptp(axis.values)) for name, axis in axes.items()}
    kinds = {(str(a.attrs.get("name", "time")), str(a.attrs.get("units", "s")))
             for a in axes.values()}  # fmt: skip
    if len(kinds) > 1:
        return spans, "share of the record's length (1)"
    ((kind, unit),) = kinds
    shown = DisplayUnit(1.0, "s") if unit == "s" else display_unit(unit, list(spans.values()), kind)
    return dict.fromkeys(names, shown.factor), plain(kind) + shown.suffix


def _times(ax: Axes, row: int, results: CandidateResults, name: str, unit: float) -> None:
    coordinate = results.predictions[name]["coordinate"].values
    length = coordinate.size - 1 if _along_grid(results) else np.ptp(coordinate) / unit
    ax.plot(length, row, "|", color=style.BLACK, markersize=6, label="record's length")
    if results.noise.length:
        ends = _quantiles(results.noise_draws(name)[results.noise.length] / unit)
        label = "correlation time or length"
        _interval(ax, ends, row, fmt="s", color=style.BLUE, label=label)


def _interval(ax: Axes, ends: FloatArray, row: float, **settings: str) -> None:
    low, median, high = ends
    ax.errorbar(median, row, xerr=[[median - low], [high - median]], elinewidth=0.9, **settings)
