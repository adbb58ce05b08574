"""A voltage history as few smooth pieces, for integration with steps as long as they can be.

The history is linear between its knots. Where many neighbouring knots lie on one
polynomial within a tolerance they are samples of a smooth curve (a sine, a plateau), and
the polynomial is taken: it is closer to that curve than the straight lines, and its pieces
are long. Elsewhere (the two knots of a step, a triangle's corners) the lines stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from deabayes.experiment import FloatArray

DEGREE = 5
FEWEST_KNOTS = 12
"""On one polynomial, twice its coefficients, before it counts as the signal's own shape."""
LARGEST_SCATTER = 5.0
"""Knots may lie this many times their scatter about a smooth curve from the polynomial."""
CUT_OFF, COARSE_CUT_OFF = 1e-4, 4e-3
"""Of second differences, of which lines cut off an eighth: what a polynomial may miss, and
what it may where even the fewest knots are too far apart for that."""
EVEN = 1e-9
"""Knots this close to even spacing, over their span, share one basis."""
SCATTER_NORM = 0.6745 * np.sqrt(924.0)
"""Median absolute sixth difference of white noise over its standard deviation."""
NOISIEST = 0.01
"""Of the peak: knots that scatter more are levels of their own, not a monitor's noise."""
STEADY = 0.01
"""Change of the voltage on a piece, over its peak, that counts as none."""
JUMP, TURN, WORTH = 0.01, 0.05, 1e-3
"""What restarts the step size: a jump, over the largest drive; a turn, over its largest
slope, if it changes the drive by this share within the piece."""
_CHEBYSHEV_POWERS = np.zeros((DEGREE + 1, DEGREE + 1))
for _n in range(DEGREE + 1):
    _shifted = np.polynomial.Chebyshev.basis(_n, domain=[0.0, 1.0])
    _CHEBYSHEV_POWERS[: _n + 1, _n] = _shifted.convert(
        kind=np.polynomial.Polynomial, domain=[-1.0, 1.0], window=[-1.0, 1.0]
    ).coef


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
    knots: FloatArray, volts: FloatArray, first: float, last: float, tolerance: float
) -> Drive:
    """Pieces of a voltage that is zero before its first knot, and constant after its last.

    Parameters
    ----------
    knots, volts : (K,) ascending times [s]; a repeated time marks a jump.
    first, last : times the pieces must span [s].
    tolerance : of the voltage relative to its peak; what the knots themselves leave open adds
        to it: their scatter about a smooth curve, and a little of what their straight lines
        cut off it.
    """
    peak = float(np.max(np.abs(volts)))
    knots, volts = _spanning(knots, volts, first, last)
    bend = float(np.median(np.abs(np.diff(volts, 2)))) if volts.size > 2 else 0.0
    allowed = tolerance * peak + CUT_OFF * bend, scatter(knots, volts)
    coarse = tolerance * peak + COARSE_CUT_OFF * bend, allowed[1]
    edges, pieces = [float(knots[0])], []
    jumps = np.append(np.flatnonzero(np.diff(knots) == 0.0), knots.size - 1)
    begin, count = 0, 1
    while begin < knots.size - 1:
        room = int(jumps[np.searchsorted(jumps, begin)]) - begin
        if room == 0:
            begin += 1
            continue
        count, coefficients = _longest(knots, volts, begin, room, allowed, count)
        if count == 1 and room >= FEWEST_KNOTS - 1:
            fit = _fit(knots, volts, begin, FEWEST_KNOTS - 1, coarse)
            count, coefficients = (1, coefficients) if fit is None else (FEWEST_KNOTS - 1, fit)
        edges.append(float(knots[begin + count]))
        pieces.append(coefficients)
        begin += count
    coefficients = np.array(pieces)
    return Drive(np.array(edges), coefficients, _restarts(np.array(edges), coefficients), peak)


def scatter(knots: FloatArray, volts: FloatArray) -> float:
    """Standard deviation of evenly spaced knots about a smooth curve (robust), 0 if uneven.

    From sixth differences, which a sine of 40 knots per period passes with 1e-5 of its
    amplitude; steps and corners are too few to count. Also 0 where it is too much for noise: an
    excitation that changes from knot to knot (random levels, a triangle of few knots) has such
    differences too, and is followed as it is.
    """
    steps = np.diff(knots)
    middle = float(np.median(steps))
    if knots.size < 4 * FEWEST_KNOTS or np.mean(np.abs(steps - middle) > 0.01 * middle) > 0.2:
        return 0.0
    found = float(np.median(np.abs(np.diff(volts, 6)))) / SCATTER_NORM
    return found if found <= NOISIEST * float(np.max(np.abs(volts))) else 0.0


def _spanning(
    knots: FloatArray, volts: FloatArray, first: float, last: float
) -> tuple[FloatArray, FloatArray]:
    """Knots from `first` to `last` at least, at least two distinct."""
    if volts[0] != 0.0 or first < knots[0]:
        before = min(first, knots[0])
        knots, volts = np.r_[before, knots[0], knots], np.r_[0.0, 0.0, volts]
        if before == knots[1]:
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
    best, found = 1, _line(volts[begin], volts[begin + 1])
    fewest, too_many = FEWEST_KNOTS - 1, room + 1
    count = min(max(fewest, before), room)
    while fewest <= count < too_many:
        fit = _fit(knots, volts, begin, count, allowed)
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
        fit = _fit(knots, volts, begin, room - fewest, allowed)
        best, found = (best, found) if fit is None else (room - fewest, fit)
    return best, found


def _line(start: float, end: float) -> FloatArray:
    return np.array([start, end - start, 0.0, 0.0, 0.0, 0.0])


def _fit(
    knots: FloatArray, volts: FloatArray, begin: int, count: int, allowed: tuple[float, float]
) -> FloatArray | None:
    """Least-squares polynomial over `count` intervals, or None if it misses knots.

    Parameters
    ----------
    allowed : misfit of a knot, and the scatter that comes on top.
    """
    time, values = knots[begin : begin + count + 1], volts[begin : begin + count + 1]
    if np.ptp(values) == 0.0:
        return _line(float(values[0]), float(values[0]))
    x = (time - time[0]) / (time[-1] - time[0])
    if np.max(np.abs(x - np.arange(count + 1) / count)) < EVEN:
        basis, to_powers = _even_basis(count)
    else:
        basis, to_powers = _basis(x)
    weights = basis.T @ values
    misfit, noise = np.abs(basis @ weights - values), allowed[1]
    if np.max(misfit) > allowed[0] + LARGEST_SCATTER * noise:
        return None
    # More than noise would leave is a shape the polynomial misses (chi-square, 2 sd).
    more = 1.0 + 2.0 * np.sqrt(2.0 / misfit.size)
    if np.mean(misfit**2) > allowed[0] ** 2 + more * noise**2:
        return None
    return np.asarray(to_powers @ weights)


def _basis(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal polynomials at `x` (M,) within [0, 1], (M, 6), and the powers they are of."""
    chebyshev = np.polynomial.chebyshev.chebvander(2.0 * x - 1.0, DEGREE)
    basis, triangle = np.linalg.qr(chebyshev)
    return basis, _CHEBYSHEV_POWERS @ np.linalg.inv(triangle)


@lru_cache(maxsize=256)
def _even_basis(count: int) -> tuple[FloatArray, FloatArray]:
    return _basis(np.arange(count + 1) / count)


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
