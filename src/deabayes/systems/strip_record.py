"""What of a tensile strip's record does not depend on draws: outputs and steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.grid import GridSettings, graded_grid, simplify

IndexArray = NDArray[np.intp]
DEFAULT_TOLERANCE = 1e-6
"""Error of the response relative to its range, for which GridSettings' defaults are made."""


@dataclass(frozen=True)
class StripRecord:
    """Outputs and integration steps of one record.

    Attributes
    ----------
    stretch, rate : (N,) at the outputs; the rate at a knot is that after it.
    duration, grid_stretch : (S,) grid steps [s] and (S + 1,) the stretch at their ends.
    first_output : (S + 1,) outputs of step s are first_output[s] to first_output[s + 1].
    order, position : (N,) outputs in ascending time, and where each lies in its step.
    reached : smallest and largest stretch until the last output; empty without time.
    """

    stretch: FloatArray
    rate: FloatArray
    duration: FloatArray
    grid_stretch: FloatArray
    first_output: IndexArray
    order: IndexArray
    position: FloatArray
    reached: FloatArray

    @cached_property
    def spring_stretch(self) -> FloatArray:
        """Where the spring must hold: the outputs, then what was reached."""
        return np.append(self.stretch, self.reached)


def record_without_time(stretch: FloatArray) -> StripRecord:
    """A quasi-static record: the stretch at the outputs, and no steps."""
    none, no_index = np.empty(0), np.empty(0, dtype=np.intp)
    return StripRecord(
        stretch, np.zeros_like(stretch), none, none, no_index, np.arange(stretch.size), none, none
    )


def record_in_time(
    knots: FloatArray, stretch: FloatArray, coordinate: FloatArray, tolerance: float
) -> StripRecord:
    """A history of stretch, constant before its first knot and after its last.

    Parameters
    ----------
    knots, stretch : (K,) times [s], ascending, and the stretch there.
    coordinate : (N,) times of the outputs, in any order.
    tolerance : error of the response relative to its range.
    """
    knots, stretch = _extended(knots, stretch, coordinate)
    segment = np.clip(np.searchsorted(knots, coordinate, side="right") - 1, 0, knots.size - 2)
    rate = np.diff(stretch) / np.diff(knots)
    kept = simplify(knots, stretch, 0.1 * tolerance * float(np.ptp(stretch)))
    grid = graded_grid(knots[kept], stretch[kept], _settings(tolerance))
    order = np.argsort(coordinate, kind="stable")
    ascending = coordinate[order]
    step = np.clip(np.searchsorted(grid, ascending, side="right") - 1, 0, grid.size - 2)
    duration = np.diff(grid)
    outputs = np.interp(coordinate, knots, stretch)
    passed = np.append(stretch[knots <= ascending[-1]], outputs[order[-1]])
    return StripRecord(
        stretch=outputs,
        rate=rate[segment],
        duration=duration,
        grid_stretch=np.interp(grid, knots[kept], stretch[kept]),
        first_output=np.searchsorted(step, np.arange(grid.size)),
        order=order,
        position=(ascending - grid[step]) / duration[step],
        reached=np.array([np.min(passed), np.max(passed)]),
    )


def _extended(
    knots: FloatArray, stretch: FloatArray, coordinate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Knots that span the outputs, at least two, by constant continuation."""
    first, last = float(np.min(coordinate)), float(np.max(coordinate))
    if first < knots[0] or knots.size == 1:
        before = first if first < knots[0] else knots[0] - 1.0
        knots, stretch = np.append(before, knots), np.append(stretch[0], stretch)
    if last > knots[-1]:
        knots, stretch = np.append(knots, last), np.append(stretch, stretch[-1])
    return knots, stretch


def _settings(tolerance: float) -> GridSettings:
    """Steps for a tolerance: the method is of order 5; never coarser than the default."""
    ratio = min(1.0, tolerance / DEFAULT_TOLERANCE)
    finer, default = ratio**0.2, GridSettings()
    return GridSettings(
        first_step=default.first_step * finer,
        growth=1.0 + (default.growth - 1.0) * finer,
        increment=default.increment * finer,
        kink=default.kink * ratio,
    )
