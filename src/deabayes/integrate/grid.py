"""Step grids from the excitation alone, so that no draw's steps depend on another's."""

from __future__ import annotations

from deabayes.experiment import FloatArray

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray



@dataclass(frozen=True)
class GridSettings:
    """How a graded grid follows a piecewise-linear signal.

    Attributes
    ----------
    first_step : step after a kink [s]; a fraction of the shortest time constant.
    growth : h = first_step + (growth - 1) x time since the kink, so that relaxations
        of every time constant are resolved alike.
    increment : largest relative change of the signal in a step.
    kink : step after a kink x its change of slope, if that is more than first_step: a
        smaller kink restarts less. What the dense output then misses is at most about
        the change of slope x the shortest time constant, for a few of these.
    """

    first_step: float = 0.015
    growth: float = 1.1
    increment: float = 0.05
    kink: float = 3e-4


def simplify(time: FloatArray, value: FloatArray, tolerance: float) -> NDArray[np.intp]:
    """Indices of the knots needed to follow the signal within `tolerance`.

    The line between two kept knots passes within `tolerance` of every knot it skips
    (each skipped knot narrows the cone of admissible slopes from the last kept one).
    """
    kept = [0]
    low, high = -np.inf, np.inf
    times, values = time.tolist(), value.tolist()
    for i in range(1, len(times)):
        anchor = kept[-1]
        slope = (values[i] - values[anchor]) / (times[i] - times[anchor])
        if not low <= slope <= high:
            kept.append(i - 1)
            anchor, low, high = i - 1, -np.inf, np.inf
        width = tolerance / (times[i] - times[anchor])
        slope = (values[i] - values[anchor]) / (times[i] - times[anchor])
        low, high = max(low, slope - width), min(high, slope + width)
    if len(times) > 1:
        kept.append(len(times) - 1)
    return np.array(kept)


def graded_grid(time: FloatArray, value: FloatArray, settings: GridSettings) -> FloatArray:
    """Times of steps that end at every knot and are fine after every kink.

    Parameters
    ----------
    time, value : (K,) knots, ascending in time; at rest before the first.

    Returns
    -------
    (S + 1,) times from the first knot to the last.
    """
    grid = [float(time[0])]
    age, slope_before = np.inf, 0.0
    for i in range(len(time) - 1):
        start, end = float(time[i]), float(time[i + 1])
        slope = float(value[i + 1] - value[i]) / (end - start)
        age = min(age, _age_after_kink(abs(slope - slope_before), settings))
        relative_rate = abs(slope) / min(value[i], value[i + 1])
        largest = settings.increment / relative_rate if relative_rate > 0.0 else np.inf
        age = _fill(grid, end, age, largest, settings)
        slope_before = slope
    return np.array(grid)


def _age_after_kink(change: float, settings: GridSettings) -> float:
    """Time since a kink that would allow the step this change of slope allows."""
    if change == 0.0:
        return np.inf
    allowed = settings.kink / change - settings.first_step
    return max(0.0, allowed) / (settings.growth - 1.0)


def _fill(
    grid: list[float], end: float, age: float, largest: float, settings: GridSettings
) -> float:
    """Append steps from the grid's last time to `end`; returns the age there."""
    while grid[-1] < end:
        remaining = end - grid[-1]
        step = min(settings.first_step + (settings.growth - 1.0) * age, largest)
        if step * settings.growth >= remaining:
            step = remaining
            grid.append(end)
        else:
            step = min(step, remaining / 2.0)
            grid.append(grid[-1] + step)
        age += step
    return age
