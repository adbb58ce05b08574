"""Regions, limits and axes of the figure `pairs`."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline

from deabayes.figures import pairs, panels


@pytest.mark.parametrize("slope", [0.0, 0.98])
@pytest.mark.parametrize("size", [500, 20000])
def test_regions_of_pairs_hold_the_draws_they_promise(size: int, slope: float) -> None:
    drawn = np.random.default_rng(3).standard_normal((2, size))
    x, y = drawn[0], slope * drawn[0] + np.sqrt(1.0 - slope**2) * drawn[1]
    ax = Figure().subplots()
    pairs._contours(ax, pairs._Column(x, "", False), pairs._Column(y, "", False))
    (filled,) = ax.collections
    rings = [ring for path in filled.get_paths() for ring in path.to_polygons()]
    points = np.column_stack([x, y])
    held = [Outline(ring).contains_points(points).mean() for ring in rings]
    assert max(held) == pytest.approx(0.9, abs=0.02)
    assert min(filled.levels) > 0.0
    inner = [ring for path in filled.get_paths()[1:] for ring in path.to_polygons()]
    inside = np.any([Outline(ring).contains_points(points) for ring in inner], axis=0)
    assert inside.mean() == pytest.approx(0.5, abs=0.02)


def test_long_tails_do_not_set_the_limits_of_pairs() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal(5000)
    low, high = pairs._Column(values, "", False).limits(0.002)
    assert (low, high) == pytest.approx(tuple(np.quantile(values, [0.002, 0.998])))
    long = np.append(values, [*np.full(50, 1e4), np.inf, np.nan])
    low, high = pairs._Column(long, "", False).limits(0.002)
    assert low > -4.0 and high < 6.0


def test_pairs_that_span_decades_have_logarithmic_axes() -> None:
    rng = np.random.default_rng(1)
    wide = 10 ** rng.normal(2.0, 0.5, 4000)
    columns = [
        pairs._Column(np.log10(wide), "wide", True),
        pairs._Column(1.0 + 0.01 * np.log10(wide), "narrow", False),
    ]
    figure = Figure()
    axes = figure.subplots(2, 2, squeeze=False, sharex="col")
    for row, column in ((0, 0), (1, 0), (1, 1)):
        y = columns[row] if column < row else None
        pairs._cell(axes[row, column], columns[column], y)
        pairs._label(axes[row, column], columns, row, column, 6.0)
    assert [axes[1, 0].get_xscale(), axes[1, 0].get_yscale()] == ["log", "linear"]
    low, high = axes[1, 0].get_xlim()
    assert (low, high) == pytest.approx(tuple(np.quantile(wide, [0.002, 0.998])), rel=0.05)
    region = axes[1, 0].collections[0].get_paths()[0].vertices
    assert low < region[:, 0].min() and region[:, 0].max() < high
    ends = np.quantile(wide, [0.05, 0.95])
    assert (region[:, 0].min(), region[:, 0].max()) == pytest.approx(tuple(ends), rel=0.25)
    assert np.corrcoef(np.log10(region[:, 0]), region[:, 1])[0, 1] > 0.85


def test_draws_of_either_sign_have_linear_axes() -> None:
    values = np.concatenate([np.linspace(-1.0, 0.9, 40), np.linspace(1.0, 100.0, 960)])
    results = SimpleNamespace(
        posterior={"x": xr.DataArray(values)}, label=lambda _: {"unit": "1", "symbol": "x"}
    )
    column = pairs._column(results, "x")
    assert not column.log
    np.testing.assert_array_equal(column.drawn, values)


@pytest.mark.parametrize(("low", "high"), [(30.0, 700.0), (0.9, 40.0), (2.0, 31.0)])
def test_few_ticks_of_a_logarithmic_axis_stand_apart(low: float, high: float) -> None:
    ax = Figure().subplots()
    panels.logarithmic(ax, np.array([low, high]), 2)
    shown = [tick for tick in ax.get_xticks() if low <= tick <= high]
    assert len(shown) == 2
    assert shown[1] >= 3.0 * shown[0], "labels of near values would overlap"
