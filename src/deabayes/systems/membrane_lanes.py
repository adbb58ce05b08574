"""The membrane's integration: draws run through the kernel's lanes, one after another."""

from __future__ import annotations

import numpy as np

from deabayes.compiled import njit
from deabayes.integrate import arrow
from deabayes.integrate.arrow import ARGUMENT, LANES, START
from deabayes.integrate.rosenbrock import KERNEL_OPTIONS, FloatArray
from deabayes.systems import membrane_kernel as k
from deabayes.systems.membrane_kernel import IndexArray
from deabayes.systems.membrane_stages import step

DRAW_COLUMNS = 9
OF_FLUIDITY, OF_MODULUS, OF_INVERSE, OF_SIGMA, OF_GAIN = range(5)
OF_ALLOWED, OF_START, OF_LIMIT, OF_STEP = range(5, DRAW_COLUMNS)
"""Columns of a draw: 1/zeta_alpha, mu_alpha, 1/J_alpha, sigma, epsilon/H^2, 1/error allowed,
pre-stretch, largest stretch, first step after a jump of the voltage."""
UNIT_COLUMNS = 4
"""Columns of a unit: 1/tau, mu, 1/J_beta, weight of its error."""
IDLE = -1
MOST_STEPS = 20_000


@njit(**KERNEL_OPTIONS)
def _load(c: FloatArray, blocks: FloatArray, i: int, draw: FloatArray, units: FloatArray) -> None:
    """Put a draw (9,) with its units (n, 4) into lane `i`, at rest."""
    c[START + i] = draw[OF_START]
    c[k.FLUIDITY + i], c[k.MODULUS + i] = draw[OF_FLUIDITY], draw[OF_MODULUS]
    c[k.INVERSE + i], c[k.SIGMA + i] = draw[OF_INVERSE], draw[OF_SIGMA]
    c[k.GAIN + i], c[k.ALLOWED + i] = draw[OF_GAIN], draw[OF_ALLOWED]
    c[k.PIVOT + i] = c[k.FORCE + i] = c[k.SCHUR + i] = 0.0
    for n in range(blocks.shape[0]):
        w = blocks[n]
        w[START + i] = draw[OF_START]
        w[k.FLUIDITY + i], w[k.MODULUS + i] = units[n, 0], units[n, 1]
        w[k.INVERSE + i], w[k.WEIGHT + i] = units[n, 2], units[n, 3]


@njit(**KERNEL_OPTIONS)
def integrate(
    edges: FloatArray,
    volts: FloatArray,
    restart: FloatArray,
    times: FloatArray,
    draws: FloatArray,
    units: FloatArray,
    stretch: FloatArray,
    steps: IndexArray,
    ended: FloatArray,
) -> None:
    """Stretch of every draw at `times`, starting at rest.

    Parameters
    ----------
    edges : (S + 1,) ends of the pieces of the excitation [s].
    volts : (S, 6) voltage on a piece [V], powers of the fraction of it that has passed.
    restart : (S,) whether the drive jumps or turns at the start of the piece (1) or not (0).
    times : (N,) ascending, from edges[0] to edges[S].
    draws : (W, 9), units : (W, n, 4); see DRAW_COLUMNS and UNIT_COLUMNS.
    stretch : (W, N) result; a row of NaN where a draw leaves its limits or fails.
    steps : (W,) result: steps tried.
    ended : (W,) result: end of the step in which a draw passed its largest stretch, or of
        the last good step of one that failed; NaN for a draw that reached the last output.
    """
    walkers, pieces, end = draws.shape[0], edges.size - 1, times[times.size - 1]
    most = MOST_STEPS + 4 * pieces
    c = np.full(k.STRETCH_ROWS * LANES, 1.0)
    blocks = np.full((units.shape[1], k.UNIT_ROWS * LANES), 1.0)
    lane_draw = np.full(LANES, IDLE)
    piece, output = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
    now, proposed = np.zeros(LANES), np.zeros(LANES)
    # One function: lanes kept in tuples of arrays for parts of it went four to seven times slower,
    # and a call for what follows a good step 1.4 to 1.6 times slower.
    waiting, running = 0, 0
    for i in range(LANES):
        c[k.PIVOT + i] = c[k.FORCE + i] = c[k.SCHUR + i] = c[k.INVERSE + i] = 0.0
    while True:
        for i in range(LANES):
            while lane_draw[i] == IDLE and waiting < walkers:
                w, waiting = waiting, waiting + 1
                steps[w], ended[w] = 0, np.nan
                if not arrow.usable(draws[w], units[w]):
                    stretch[w], ended[w] = np.nan, edges[0]
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
        step(c, blocks)
        for i in range(LANES):
            w = lane_draw[i]
            if w == IDLE:
                continue
            steps[w] += 1
            h, factor, first = c[k.STEP + i], c[k.FACTOR + i], draws[w, OF_STEP]
            lost = steps[w] > most
            if c[k.ERROR + i] <= 1.0:
                after = edges[piece[i] + 1]
                last = h == after - now[i]
                reached = after if last else now[i] + h
                output[i] = arrow.write_outputs(
                    times, output[i], now[i], h, reached, c[START + i], c[ARGUMENT + i],
                    c[k.K2 + i], c[k.K3 + i], c[k.K4 + i], stretch[w],
                )  # fmt: skip
                c[START + i] = c[ARGUMENT + i]
                for n in range(units.shape[1]):
                    blocks[n, START + i] = blocks[n, ARGUMENT + i]
                now[i] = reached
                proposed[i] = max(h * factor, proposed[i]) if h < proposed[i] else h * factor
                lost |= not c[START + i] <= draws[w, OF_LIMIT]
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
                stretch[w], ended[w] = np.nan, now[i]
                lane_draw[i], running = IDLE, running - 1
