"""The minimum-energy structure's integration: draws run through lanes, one after another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate.arrow import ARGUMENT, LANES, START
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems import structure_kernel as k
from deabayes.systems.structure_stages import step

IndexArray = NDArray[np.int64]
OF_START, OF_STEP, OF_LOW, OF_HIGH, OF_CONSTANTS = range(5)
"""Columns of a draw: starting angle, first step after a jump of the voltage, the angles
between which it stays, and from there on the constants in the order of the kernel's rows."""
CONSTANTS = 17
OF_DRY = OF_CONSTANTS + (k.DRY - k.INERTIA) // LANES
DRAW_COLUMNS = OF_CONSTANTS + CONSTANTS + k.FILM_DEGREE + 1
UNIT_COLUMNS = 4
"""Columns of a unit: 1/tau, k, weight of its error, y at the start."""
IDLE = -1
MOST_STEPS = 200_000
"""A structure that rings at 60 Hz for 50 s takes 100 000."""


@njit(**KERNEL_OPTIONS)
def _load(c: FloatArray, blocks: FloatArray, i: int, draw: FloatArray, units: FloatArray) -> None:
    """Put a draw with its units (n, 4) into lane `i`, at rest."""
    c[START + i], c[k.SPEED + START + i] = draw[OF_START], 0.0
    for row in range(CONSTANTS):
        c[k.INERTIA + row * LANES + i] = draw[OF_CONSTANTS + row]
    for power in range(k.FILM_DEGREE + 1):
        c[k.S0 + power * LANES + i] = draw[OF_CONSTANTS + CONSTANTS + power]
    for n in range(blocks.shape[0]):
        w = blocks[n]
        w[k.RATE + i], w[k.STIFFNESS + i] = units[n, 0], units[n, 1]
        w[k.WEIGHT + i], w[START + i] = units[n, 2], units[n, 3]


@njit(**KERNEL_OPTIONS)
def displacement(angle: FloatArray, length: FloatArray, rest: FloatArray) -> FloatArray:
    """Displacement (W, N) of the slider at angles (W, N): numpy's cosine took a quarter of all."""
    found = np.empty_like(angle)
    for w in range(angle.shape[0]):
        at_rest = k.sine_cosine(rest[w])[1]
        for n in range(angle.shape[1]):
            found[w, n] = 2.0 * length[w] * (k.sine_cosine(angle[w, n])[1] - at_rest)
    return found


@njit(**KERNEL_OPTIONS)
def integrate(
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draws: FloatArray,
    units: FloatArray,
    most_steps: int,
    angle: FloatArray,
    steps: IndexArray,
    ended: FloatArray,
) -> None:
    """Angle of every draw at `times`, starting without speed.

    Parameters
    ----------
    edges : (S + 1,) ends of the pieces of the excitation [s].
    volts : (S, 6) voltage on a piece [V], powers of the fraction of it that has passed.
    restart : (S,) whether the drive jumps or turns at the start of the piece (1) or not (0).
    times : (N,) ascending, from edges[0] to edges[S].
    draws : (W, DRAW_COLUMNS), units : (W, n, 4).
    most_steps : of a draw, which is lost where it needs more.
    angle : (W, N) result; a row of NaN where a draw leaves its limits or fails.
    steps : (W,) result: steps tried.
    ended : (W,) result: when a draw left its limits or failed; NaN for one that did not.
    """
    walkers, end = draws.shape[0], times[times.size - 1]
    c = np.full(k.ANGLE_ROWS * LANES, 0.5)
    blocks = np.full((units.shape[1], k.UNIT_ROWS * LANES), 0.0)
    lane_draw = np.full(LANES, IDLE)
    piece, output = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    now, proposed = np.zeros(LANES), np.zeros(LANES)
    # One function: lanes kept in tuples of arrays for parts of it went four to seven times slower,
    # and a call for what follows a good step 1.4 to 1.6 times slower.
    waiting, running = 0, 0
    dry = np.any(draws[:, OF_DRY] > 0.0)
    while True:
        for i in range(LANES):
            while lane_draw[i] == IDLE and waiting < walkers:
                w, waiting = waiting, waiting + 1
                steps[w], ended[w] = 0, np.nan
                if not arrow.usable(draws[w], units[w]):
                    angle[w], ended[w] = np.nan, edges[0]
                    continue
                _load(c, blocks, i, draws[w], units[w])
                arrow.enter_piece(c, i, k.SPAN, k.V0, edges, volts, 0)
                lane_draw[i], piece[i], output[i] = w, 0, 0
                now[i], proposed[i] = edges[0], draws[w, OF_STEP]
                running += 1
            if lane_draw[i] != IDLE:
                begin = edges[piece[i]]
                c[k.STEP + i] = arrow.fitted_step(proposed[i], edges[piece[i] + 1] - now[i])
                c[k.OFFSET + i] = (now[i] - begin) * c[k.SPAN + i]
        if running == 0:
            break
        step(c, blocks, dry)
        for i in range(LANES):
            w = lane_draw[i]
            if w == IDLE:
                continue
            steps[w] += 1
            h, factor, first = c[k.STEP + i], c[k.FACTOR + i], draws[w, OF_STEP]
            lost = steps[w] > most_steps
            if c[k.ERROR + i] <= 1.0:
                after = edges[piece[i] + 1]
                last = h == after - now[i]
                reached = after if last else now[i] + h
                output[i] = arrow.write_outputs(
                    times, output[i], now[i], h, reached, c[START + i], c[ARGUMENT + i],
                    c[k.K2 + i], c[k.K3 + i], c[k.K4 + i], angle[w],
                )  # fmt: skip
                c[START + i], c[k.SPEED + START + i] = c[ARGUMENT + i], c[k.SPEED + ARGUMENT + i]
                for n in range(units.shape[1]):
                    blocks[n, START + i] = blocks[n, ARGUMENT + i]
                now[i] = reached
                proposed[i] = max(h * factor, proposed[i]) if h < proposed[i] else h * factor
                lost |= not draws[w, OF_LOW] <= c[START + i] <= draws[w, OF_HIGH]
                if not lost and (output[i] == times.size or reached >= end):
                    lane_draw[i], running = IDLE, running - 1
                elif last and not lost:
                    piece[i] += 1
                    arrow.enter_piece(c, i, k.SPAN, k.V0, edges, volts, piece[i])
                    if restart[piece[i]] > 0.0:
                        proposed[i] = min(proposed[i], first)
            else:
                proposed[i] = h * min(factor, 0.8)
                lost |= proposed[i] < arrow.FINEST * first
            if lost and lane_draw[i] != IDLE:
                angle[w], ended[w] = np.nan, now[i]
                lane_draw[i], running = IDLE, running - 1
