"""Compiled kernel of the tensile strip: Maxwell units under a prescribed stretch.

One unit (equations.md, section 2; q = 1/J, q = 0 is neo-Hookean), uniaxial:

    B = lambda xi^2 (1 + 3 q) - q (lambda^3 + 2 xi^3)      (Gent argument = B/(lambda xi^2))
    xi' = (1/tau) (lambda^3 - xi^3)/(xi B),      P/mu = (lambda^3 - xi^3)/(lambda B)

Units do not act on one another, so each is a scalar equation. Its steps are those of a
grid common to all draws; where the embedded error of one draw's unit exceeds its limit,
that step of that unit alone is repeated with sizes of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.compiled import njit
from deabayes.integrate import rodas5p as t
from deabayes.integrate.rosenbrock import (
    KERNEL_OPTIONS,
    LANES,
    FloatArray,
    interpolate,
    size_factor,
)

SMALLEST_FRACTION = 1e-7
"""Of a grid step: a unit that needs smaller steps has failed."""
MOST_TRIED = 1000
"""Steps within a grid step: a unit that needs more has failed (usual are 2 to 50)."""
ROWS = 11
GAUGE, INVERSE, RATE, MODULUS, LIMIT, START, END, ERROR, K2, K3, K4 = (
    row * LANES for row in range(ROWS)
)
"""Offsets of a block's rows in one flat work array: from a single array the compiler
sees that the rows do not overlap, and makes vectors of the lanes."""


@njit(**KERNEL_OPTIONS)
def _flow(stretch: float, xi: float, hr: float, q: float) -> tuple[float, float]:
    """h xi' with hr = h/tau, and its denominator xi B, which must be positive."""
    cube = xi * xi * xi
    stretch_cube = stretch * stretch * stretch
    below = stretch * cube * (1.0 + 3.0 * q) - q * xi * (stretch_cube + 2.0 * cube)
    return hr * (stretch_cube - cube) / below, below


@njit(**KERNEL_OPTIONS)
def _stress(stretch: float, xi: float, q: float) -> float:
    """Nominal stress of a unit over its modulus."""
    cube = xi * xi * xi
    stretch_cube = stretch * stretch * stretch
    b = stretch * xi * xi * (1.0 + 3.0 * q) - q * (stretch_cube + 2.0 * cube)
    return (stretch_cube - cube) / (stretch * b)


@njit(inline="always", **KERNEL_OPTIONS)
def _step(
    lam: float, change: float, y: float, hr: float, q: float
) -> tuple[float, float, float, float, float]:
    """One Rodas5P step: end value, dense-output k2..k4, error of the stress over mu.

    `change` is the stretch's increment over the step; hr = h/tau. The error is that of
    the embedded formula times dP/dxi at the start; NaN past the Gent limit.
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

    u1 = scale * (hr * ratio + t.D1 * drift)
    f, low2 = _flow(lam + t.NODE2 * change, y + t.A21 * u1, hr, q)
    u2 = scale * (f + t.C21 * u1 + t.D2 * drift)
    f, low3 = _flow(lam + t.NODE3 * change, y + t.A31 * u1 + t.A32 * u2, hr, q)
    u3 = scale * (f + t.C31 * u1 + t.C32 * u2 + t.D3 * drift)
    f, low4 = _flow(lam + t.NODE4 * change, y + t.A41 * u1 + t.A42 * u2 + t.A43 * u3, hr, q)
    u4 = scale * (f + t.C41 * u1 + t.C42 * u2 + t.C43 * u3 + t.D4 * drift)
    y5 = y + t.A51 * u1 + t.A52 * u2 + t.A53 * u3 + t.A54 * u4
    f, low5 = _flow(lam + t.NODE5 * change, y5, hr, q)
    u5 = scale * (f + t.C51 * u1 + t.C52 * u2 + t.C53 * u3 + t.C54 * u4 + t.D5 * drift)
    end = lam + change
    y6 = y + t.A61 * u1 + t.A62 * u2 + t.A63 * u3 + t.A64 * u4 + t.A65 * u5
    f, low6 = _flow(end, y6, hr, q)
    u6 = scale * (f + t.C61 * u1 + t.C62 * u2 + t.C63 * u3 + t.C64 * u4 + t.C65 * u5)
    y7 = y6 + u6
    f, low7 = _flow(end, y7, hr, q)
    u7 = scale * (f + t.C71 * u1 + t.C72 * u2 + t.C73 * u3 + t.C74 * u4 + t.C75 * u5 + t.C76 * u6)
    y8 = y7 + u7
    f, low8 = _flow(end, y8, hr, q)
    u8 = scale * (
        f + t.C81 * u1 + t.C82 * u2 + t.C83 * u3 + t.C84 * u4 + t.C85 * u5 + t.C86 * u6 + t.C87 * u7
    )
    k2 = t.H21 * u1 + t.H22 * u2 + t.H23 * u3 + t.H24 * u4 + t.H25 * u5 + t.H26 * u6
    k2 += t.H27 * u7 + t.H28 * u8
    k3 = t.H31 * u1 + t.H32 * u2 + t.H33 * u3 + t.H34 * u4 + t.H35 * u5 + t.H36 * u6
    k3 += t.H37 * u7 + t.H38 * u8
    k4 = t.H41 * u1 + t.H42 * u2 + t.H43 * u3 + t.H44 * u4 + t.H45 * u5 + t.H46 * u6
    k4 += t.H47 * u7 + t.H48 * u8
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
    """Repeat a grid step of one unit of draw `i` with sizes of its own.

    `positions` (M,) are the outputs as fractions of the grid step; their stress is added
    to `stress` (M,). Sets the end value, NaN on failure; returns the steps tried.
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
    """One grid step of a unit of LANES draws; returns how many exceed their limit."""
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
    """Add the stress at one output to `stress` (LANES,), of the draws whose step passed."""
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
    """Nominal stress of all Maxwell units, summed into `stress`.

    Parameters
    ----------
    duration : (S,) grid steps [s]; stretch (S + 1,) at their ends.
    first_output : (S + 1,) output `o` lies in step s if first_output[s] <= o < [s + 1].
    position, output_stretch : (N,) fraction of its step and stretch of each output.
    draws : (B, n, 5, LANES) blocks of draws, for each unit: factor on stretch - 1
        (nominal gauge length over the draw's), 1/J, 1/tau, mu, error of P/mu allowed in
        a step.
    stress : (B, N, LANES) [Pa], added to.

    Returns
    -------
    (B, LANES) steps taken in repetition of grid steps.
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
