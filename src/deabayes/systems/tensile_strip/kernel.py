"""Compiled kernel of the tensile strip, and the preparation of a record for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate import rodas5p as t
from deabayes.integrate.compiled import njit
from deabayes.integrate.drive import GridSettings, graded_grid, simplify
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, LANES, interpolate, size_factor

SMALLEST_FRACTION = 1e-7
"""Smallest step over a grid step; a unit that needs a smaller one has failed."""
MOST_TRIED = 1000
"""Largest number of steps in a grid step; a unit that needs more has failed (usual: 2 to 50)."""
ROWS = 11
GAUGE, INVERSE, RATE, MODULUS, LIMIT, START, END, ERROR, K2, K3, K4 = (
    row * LANES for row in range(ROWS)
)
"""Offsets of a block's rows in one flat work array. With a single array the compiler knows that
the rows do not overlap, and vectorises the loops over lanes."""


@njit(**KERNEL_OPTIONS)
def _flow(stretch: float, xi: float, hr: float, q: float) -> tuple[float, float]:
    """Return h xi' with hr = h/tau, and its denominator xi B, which must be positive."""
    cube = xi * xi * xi
    stretch_cube = stretch * stretch * stretch
    below = stretch * cube * (1.0 + 3.0 * q) - q * xi * (stretch_cube + 2.0 * cube)
    return hr * (stretch_cube - cube) / below, below


@njit(**KERNEL_OPTIONS)
def _stress(stretch: float, xi: float, q: float) -> float:
    """Nominal stress of a unit divided by its modulus."""
    cube = xi * xi * xi
    stretch_cube = stretch * stretch * stretch
    b = stretch * xi * xi * (1.0 + 3.0 * q) - q * (stretch_cube + 2.0 * cube)
    return (stretch_cube - cube) / (stretch * b)


@njit(inline="always", **KERNEL_OPTIONS)
def _plus(start: float, weights: tuple[float, ...], increments: tuple[float, ...]) -> float:
    """Return start + sum_j weights_j u_j; the compiler unrolls the loop."""
    for j in range(len(weights)):
        start += weights[j] * increments[j]
    return start


@njit(inline="always", **KERNEL_OPTIONS)
def _step(
    lam: float, change: float, y: float, hr: float, q: float
) -> tuple[float, float, float, float, float]:
    """Make one Rodas5P step; return end value, dense output k2..k4, error of the stress over mu.

    `change` is the increment of the stretch in the step; hr = h/tau. The error is the error of
    the embedded formula times dP/dxi at the start; it is NaN past the Gent limit.
    """
    cube = y * y * y
    lam2 = lam * lam
    stiffening = 1.0 + 3.0 * q
    above = lam2 * lam - cube
    below = lam * cube * stiffening - q * y * (lam2 * lam + 2.0 * cube)
    ratio = above / below
    below_y = 3.0 * lam * y * y * stiffening - q * (lam2 * lam + 8.0 * cube)
    below_lam = cube * stiffening - 3.0 * q * y * lam2
    slope = (-3.0 * y * y - ratio * below_y) / below
    drift = hr * change * (3.0 * lam2 - ratio * below_lam) / below
    scale = 1.0 / (1.0 / t.GAMMA - hr * slope)

    u1 = scale * (hr * ratio + t.D[0] * drift)
    f, low2 = _flow(lam + t.NODES[1] * change, _plus(y, t.A[1], (u1,)), hr, q)
    u2 = scale * (_plus(f, t.C[1], (u1,)) + t.D[1] * drift)
    f, low3 = _flow(lam + t.NODES[2] * change, _plus(y, t.A[2], (u1, u2)), hr, q)
    u3 = scale * (_plus(f, t.C[2], (u1, u2)) + t.D[2] * drift)
    f, low4 = _flow(lam + t.NODES[3] * change, _plus(y, t.A[3], (u1, u2, u3)), hr, q)
    u4 = scale * (_plus(f, t.C[3], (u1, u2, u3)) + t.D[3] * drift)
    f, low5 = _flow(lam + t.NODES[4] * change, _plus(y, t.A[4], (u1, u2, u3, u4)), hr, q)
    u5 = scale * (_plus(f, t.C[4], (u1, u2, u3, u4)) + t.D[4] * drift)
    end, y6 = lam + change, _plus(y, t.A[5], (u1, u2, u3, u4, u5))
    f, low6 = _flow(end, y6, hr, q)
    u6 = scale * _plus(f, t.C[5], (u1, u2, u3, u4, u5))
    y7 = y6 + u6
    f, low7 = _flow(end, y7, hr, q)
    u7 = scale * _plus(f, t.C[6], (u1, u2, u3, u4, u5, u6))
    y8 = y7 + u7
    f, low8 = _flow(end, y8, hr, q)
    u8 = scale * _plus(f, t.C[7], (u1, u2, u3, u4, u5, u6, u7))
    u = (u1, u2, u3, u4, u5, u6, u7, u8)
    k2, k3, k4 = _plus(0.0, t.H2, u), _plus(0.0, t.H3, u), _plus(0.0, t.H4, u)
    error = abs(u8) * (abs(slope) * y + abs(ratio)) / lam
    inside = (below > 0.0) & (low2 > 0.0) & (low3 > 0.0) & (low4 > 0.0) & (low5 > 0.0)
    inside &= (low6 > 0.0) & (low7 > 0.0) & (low8 > 0.0)
    return y8 + u8, k2, k3, k4, error if inside else np.nan


@njit(**KERNEL_OPTIONS)
def _repeat_step(
    work: FloatArray,
    i: int,
    before: float,
    change: float,
    duration: float,
    positions: FloatArray,
    stretch: FloatArray,
    stress: FloatArray,
) -> int:
    """Repeat a grid step of one unit of draw `i` in smaller steps; return the steps tried.

    `positions` (M,) are the outputs as fractions of the grid step. Their stress is added to
    `stress` (M,). The end value is written into `work`; it is NaN on failure.
    """
    gauge, q, hr = work[GAUGE + i], work[INVERSE + i], duration * work[RATE + i]
    limit, y = work[LIMIT + i], work[START + i]
    done, size, tried, output = 0.0, 0.5, 0, 0
    while done < 1.0 and size > SMALLEST_FRACTION and tried < MOST_TRIED and np.isfinite(y):
        size = min(size, 1.0 - done)
        lam = 1.0 + gauge * (before + done * change)
        end, k2, k3, k4, error = _step(lam, gauge * size * change, y, size * hr, q)
        tried += 1
        if error <= limit:
            last = done + size >= 1.0
            while output < positions.size and (last or positions[output] <= done + size):
                xi = interpolate((positions[output] - done) / size, y, end, k2, k3, k4)
                here = 1.0 + gauge * (stretch[output] - 1.0)
                stress[output] += work[MODULUS + i] * _stress(here, xi, q)
                output += 1
            y = end
            done = 1.0 if last else done + size
        size *= size_factor(error / limit)
    if done < 1.0:
        stress[output:] = np.nan
        y = np.nan
    work[END + i] = y
    return tried


@njit(**KERNEL_OPTIONS)
def _step_lanes(work: FloatArray, before: float, change: float, duration: float) -> int:
    """Make one grid step of a unit of LANES draws; return how many exceed their error limit."""
    for i in range(LANES):
        lam = 1.0 + work[GAUGE + i] * before
        lam_change = work[GAUGE + i] * change
        end, k2, k3, k4, error = _step(
            lam, lam_change, work[START + i], duration * work[RATE + i], work[INVERSE + i]
        )
        work[END + i], work[ERROR + i] = end, error
        work[K2 + i], work[K3 + i], work[K4 + i] = k2, k3, k4
    failures = 0
    for i in range(LANES):
        failures += 0 if work[ERROR + i] <= work[LIMIT + i] else 1
    return failures


@njit(**KERNEL_OPTIONS)
def _add_outputs(work: FloatArray, position: float, strain: float, stress: FloatArray) -> None:
    """Add the stress at one output to `stress` (LANES,), for draws within their error limit."""
    for i in range(LANES):
        xi = interpolate(
            position, work[START + i], work[END + i], work[K2 + i], work[K3 + i], work[K4 + i]
        )
        p = work[MODULUS + i] * _stress(1.0 + work[GAUGE + i] * strain, xi, work[INVERSE + i])
        stress[i] += p if work[ERROR + i] <= work[LIMIT + i] else 0.0


@njit(**KERNEL_OPTIONS)
def unit_stress(
    duration: FloatArray,
    stretch: FloatArray,
    first_output: NDArray[np.intp],
    position: FloatArray,
    output_stretch: FloatArray,
    draws: FloatArray,
    stress: FloatArray,
) -> NDArray[np.int64]:
    """Add the nominal stress of all Maxwell units to `stress`.

    Parameters
    ----------
    duration : (S,) grid steps [s].
    stretch : (S + 1,) stretch at the ends of the grid steps.
    first_output : (S + 1,) output `o` is in step s if first_output[s] <= o < first_output[s + 1].
    position, output_stretch : (N,) position of an output as a fraction of its step, and stretch.
    draws : (B, n, 5, LANES) blocks of draws with, for each unit: factor on stretch - 1
        (nominal gauge length over the draw's gauge length), 1/J, 1/tau, mu, error of P/mu
        allowed in a step.
    stress : (B, N, LANES) [Pa], to which the stress is added.

    Returns
    -------
    (B, LANES) number of steps in repeated grid steps.
    """
    repeated = np.zeros((draws.shape[0], LANES), np.int64)
    work = np.empty(ROWS * LANES)
    for block in range(draws.shape[0]):
        for unit in range(draws.shape[1]):
            work[: 5 * LANES] = draws[block, unit].ravel()
            for i in range(LANES):
                work[START + i] = 1.0 + work[GAUGE + i] * (stretch[0] - 1.0)
            for s in range(duration.size):
                before, change = stretch[s] - 1.0, stretch[s + 1] - stretch[s]
                failures = _step_lanes(work, before, change, duration[s])
                first, last = first_output[s], first_output[s + 1]
                for o in range(first, last):
                    _add_outputs(work, position[o], output_stretch[o] - 1.0, stress[block, o])
                if failures > 0:
                    for i in range(LANES):
                        if not work[ERROR + i] <= work[LIMIT + i]:
                            repeated[block, i] += _repeat_step(
                                work, i, before, change, duration[s],
                                position[first:last],
                                output_stretch[first:last],
                                stress[block, first:last, i],
                            )  # fmt: skip
                work[START : START + LANES] = work[END : END + LANES]
    return repeated


IndexArray = NDArray[np.intp]
DEFAULT_TOLERANCE = 1e-6
"""Error of the response relative to its range that the defaults of GridSettings give."""


@dataclass(frozen=True)
class StripRecord:
    """Outputs and integration steps of one record.

    Attributes
    ----------
    stretch, rate : (N,) at the outputs; the rate at a knot is the rate after the knot.
    duration, grid_stretch : (S,) grid steps [s] and (S + 1,) the stretch at their ends.
    first_output : (S + 1,) step s has the outputs first_output[s] to first_output[s + 1] - 1.
    order, position : (N,) indices that sort the outputs by time, and for the sorted outputs the
        position as a fraction of the step.
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
        """Stretches at which the spring is evaluated: `stretch` at the outputs, then `reached`."""
        return np.append(self.stretch, self.reached)


def record_without_time(stretch: FloatArray) -> StripRecord:
    """Return a quasi-static record: the stretch at the outputs, and no steps."""
    none, no_index = np.empty(0), np.empty(0, dtype=np.intp)
    return StripRecord(
        stretch, np.zeros_like(stretch), none, none, no_index, np.arange(stretch.size), none, none
    )


def record_in_time(
    knots: FloatArray, stretch: FloatArray, coordinate: FloatArray, tolerance: float
) -> StripRecord:
    """Return the record of a stretch that is constant before its first and after its last knot.

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
    """Extend knots and stretch by constant values to span the outputs with at least two knots."""
    first, last = float(np.min(coordinate)), float(np.max(coordinate))
    if first < knots[0] or knots.size == 1:
        before = first if first < knots[0] else knots[0] - 1.0
        knots, stretch = np.append(before, knots), np.append(stretch[0], stretch)
    if last > knots[-1]:
        knots, stretch = np.append(knots, last), np.append(stretch, stretch[-1])
    return knots, stretch


def _settings(tolerance: float) -> GridSettings:
    """Return grid settings for a tolerance and a method of order 5; never coarser than default."""
    ratio = min(1.0, tolerance / DEFAULT_TOLERANCE)
    finer, default = ratio**0.2, GridSettings()
    return GridSettings(
        first_step=default.first_step * finer,
        growth=1.0 + (default.growth - 1.0) * finer,
        increment=default.increment * finer,
        kink=default.kink * ratio,
    )
