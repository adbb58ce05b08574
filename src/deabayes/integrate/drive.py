"""A voltage history as few smooth pieces, for integration with steps as long as they can be.

The history is linear between its knots. Where many neighbouring knots lie on one
polynomial within a tolerance they are samples of a smooth curve (a sine, a plateau), and
the polynomial is taken: it is closer to that curve than the straight lines, and its pieces
are long. Elsewhere (the two knots of a step, a triangle's corners) the lines stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.integrate.smooth_piece import DEGREE, fitted, line
from deabayes.roughness import roughness

FEWEST_KNOTS = 12
"""On one polynomial, twice its coefficients, before it counts as the signal's own shape."""
CUT_OFF, COARSE_CUT_OFF = 1e-4, 4e-3
"""Of second differences, of which lines cut off an eighth: what a polynomial may miss, and
what it may where even the fewest knots are too far apart for that."""
STEADY = 0.01
"""Change of the voltage on a piece, over its peak, that counts as none."""
JUMP, TURN, WORTH = 0.01, 0.05, 1e-3
"""What restarts the step size: a jump, over the largest drive; a turn, over its largest
slope, if it changes the drive by this share within the piece."""


@dataclass(frozen=True)
class Drive:
    """Pieces of a voltage history.

    Attributes
    ----------
    edges : (S + 1,) their ends [s].
    coefficients : (S, 6) voltage [V] in powers of the fraction of the piece that has passed.
    restart : (S,) 1 where the squared voltage jumps or turns at the start of the piece.
    peak : largest magnitude of the voltage at the knots [V].
    """

    edges: FloatArray
    coefficients: FloatArray
    restart: FloatArray
    peak: float

    @cached_property
    def varies(self) -> bool:
        """Whether the voltage changes over more than a twentieth of the time."""
        powers = np.linspace(0.0, 1.0, 9)[:, np.newaxis] ** np.arange(DEGREE + 1)
        change = np.ptp(self.coefficients @ powers.T, axis=1) > STEADY * self.peak
        length = np.diff(self.edges)
        return bool(np.sum(length[change]) > 0.05 * np.sum(length))

    def at(self, time: FloatArray) -> FloatArray:
        """Voltage (N,) [V]; at a jump, that after it."""
        piece = np.searchsorted(self.edges, time, side="right") - 1
        piece = np.clip(piece, 0, len(self.coefficients) - 1)
        x = (time - self.edges[piece]) / np.diff(self.edges)[piece]
        powers = x[:, np.newaxis] ** np.arange(DEGREE + 1)
        return np.asarray(np.sum(self.coefficients[piece] * powers, axis=1))


def drive(
    knots: FloatArray,
    volts: FloatArray,
    first: float,
    last: float,
    tolerance: float,
    noisy: bool = False,
    before: float = 0.0,
) -> Drive:
    """Pieces of a voltage, constant before its first knot and after its last.

    Parameters
    ----------
    knots, volts : (K,) ascending times [s]; a repeated time marks a jump.
    first, last : times the pieces must span [s].
    tolerance : of the voltage relative to its peak; what the knots themselves leave open adds
        to it: a little of what straight lines cut off a smooth curve and, where they are
        `noisy`, their scatter about it.
    before : voltage before the first knot [V].
    """
    peak = float(np.max(np.abs(volts)))
    knots, volts = _spanning(knots, volts, (first, last), before)
    bend = float(np.median(np.abs(np.diff(volts, 2)))) if volts.size > 2 else 0.0
    noise = scatter(knots, volts) if noisy else 0.0
    allowed = tolerance * peak + CUT_OFF * bend, noise
    coarse = tolerance * peak + COARSE_CUT_OFF * bend, noise
    edges, pieces = [float(knots[0])], []
    jumps = np.append(np.flatnonzero(np.diff(knots) == 0.0), knots.size - 1)
    begin, after_jump, count = 0, 0, 1
    while begin < knots.size - 1:
        room = int(jumps[np.searchsorted(jumps, begin)]) - begin
        if room == 0:
            begin = after_jump = begin + 1
            continue
        count, coefficients = _longest(knots, volts, begin, room, allowed, count)
        if count == 1:
            count, coefficients = _shortest(knots, volts, begin, room, after_jump, coarse)
        edges.append(float(knots[begin + count]))
        pieces.append(coefficients)
        begin += count
    coefficients = np.array(pieces)
    return Drive(np.array(edges), coefficients, _restarts(np.array(edges), coefficients), peak)


def scatter(knots: FloatArray, volts: FloatArray) -> float:
    """Standard deviation of evenly spaced knots about a smooth curve, 0 if uneven.

    See `roughness`; what is too much for noise is followed as it is.
    """
    steps = np.diff(knots)
    middle = float(np.median(steps))
    if knots.size < 4 * FEWEST_KNOTS or np.mean(np.abs(steps - middle) > 0.01 * middle) > 0.2:
        return 0.0
    return roughness(volts)


def _spanning(
    knots: FloatArray, volts: FloatArray, span: tuple[float, float], before: float
) -> tuple[FloatArray, FloatArray]:
    """Knots over the span at least, at least two distinct."""
    first, last = span
    if volts[0] != before or first < knots[0]:
        start = min(first, knots[0])
        knots, volts = np.r_[start, knots[0], knots], np.r_[before, before, volts]
        if start == knots[1]:
            knots, volts = knots[1:], volts[1:]
    if last > knots[-1] or knots[-1] == knots[0]:
        knots, volts = np.append(knots, max(last, knots[-1] + 1.0)), np.append(volts, volts[-1])
    return knots, volts


def _longest(
    knots: FloatArray,
    volts: FloatArray,
    begin: int,
    room: int,
    allowed: tuple[float, float],
    before: int,
) -> tuple[int, FloatArray]:
    """Knot intervals, of `room`, of the longest piece from `begin`, and its coefficients.

    Parameters
    ----------
    before : knot intervals of the piece before, to try first.
    """
    best, found = 1, line(volts[begin], volts[begin + 1])
    fewest, too_many = FEWEST_KNOTS - 1, room + 1
    count = min(max(fewest, before), room)
    while fewest <= count < too_many:
        fit = fitted(knots, volts, begin, count, allowed)
        if fit is None:
            too_many = count
        else:
            best, found = count, fit
        if too_many <= 1.05 * best + 1.0 or best == room:
            break
        if too_many > room:
            count = min(2 * best, room)
        else:
            count = max((best + too_many) // 2, fewest)
    if 0 < room - best < fewest <= room - fewest:
        # Leave the last piece enough knots to be smooth too.
        fit = fitted(knots, volts, begin, room - fewest, allowed)
        best, found = (best, found) if fit is None else (room - fewest, fit)
    return best, found


def _shortest(
    knots: FloatArray,
    volts: FloatArray,
    begin: int,
    room: int,
    after_jump: int,
    allowed: tuple[float, float],
) -> tuple[int, FloatArray]:
    """As `_longest`, of the fewest knots: those before `begin` are used where room is less.

    Parameters
    ----------
    after_jump : the first knot after the last jump.
    """
    fewest = FEWEST_KNOTS - 1
    start = min(begin, begin + room - fewest)
    fit = fitted(knots, volts, start, fewest, allowed) if start >= after_jump else None
    if fit is None:
        return 1, line(volts[begin], volts[begin + 1])
    before = (knots[begin] - knots[start]) / (knots[start + fewest] - knots[start])
    rest, found = np.polynomial.Polynomial([before, 1.0 - before]), np.zeros(DEGREE + 1)
    powers = np.asarray(np.polynomial.Polynomial(fit)(rest).coef, dtype=float)
    found[: powers.size] = powers
    return min(room, fewest), found


def _restarts(edges: FloatArray, coefficients: FloatArray) -> FloatArray:
    """1 where the squared voltage jumps or turns, and at the start."""
    start, end = coefficients[:, 0], coefficients.sum(axis=1)
    length = np.diff(edges)
    slope_start = 2.0 * start * coefficients[:, 1] / length
    slope_end = 2.0 * end * (coefficients @ np.arange(DEGREE + 1)) / length
    jump = np.abs(start[1:] ** 2 - end[:-1] ** 2)
    turn = np.abs(slope_start[1:] - slope_end[:-1])
    largest = max(float(np.max(np.abs(np.r_[slope_start, slope_end]))), 1e-300)
    peak = max(float(np.max(np.r_[start, end] ** 2)), 1e-300)
    worth = turn * length[1:] > WORTH * peak
    sharp = (jump > JUMP * peak) | ((turn > TURN * largest) & worth)
    return np.r_[1.0, sharp.astype(float)]
