"""Fit few polynomials to a voltage history, and build step grids from a signal alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.integrate.periodic import roughness

DEGREE = 5
LARGEST_SCATTER = 5.0
"""Largest misfit of a knot beyond the tolerance, in standard deviations of the knots' noise."""
LONGEST_GAP = 4.0
"""Longest gap in mean distances of the knots; a polynomial is unconstrained in a longer gap."""
EVEN = 1e-9
"""Deviation from even spacing, over the span, up to which knots share the basis of even ones."""
_CHEBYSHEV_POWERS = np.zeros((DEGREE + 1, DEGREE + 1))
for _n in range(DEGREE + 1):
    _shifted = np.polynomial.Chebyshev.basis(_n, domain=[0.0, 1.0])
    _CHEBYSHEV_POWERS[: _n + 1, _n] = _shifted.convert(
        kind=np.polynomial.Polynomial, domain=[-1.0, 1.0], window=[-1.0, 1.0]
    ).coef


def line(start: float, end: float) -> FloatArray:
    return np.array([start, end - start, 0.0, 0.0, 0.0, 0.0])


def fitted(
    knots: FloatArray, volts: FloatArray, begin: int, count: int, allowed: tuple[float, float]
) -> FloatArray | None:
    """Least-squares polynomial over `count` intervals, or None if it misses knots.

    Parameters
    ----------
    allowed : tolerated misfit of a knot, and standard deviation of the knots' noise.
    """
    time, values = knots[begin : begin + count + 1], volts[begin : begin + count + 1]
    if np.ptp(values) == 0.0:
        return line(float(values[0]), float(values[0]))
    x = (time - time[0]) / (time[-1] - time[0])
    if np.max(np.abs(x - np.arange(count + 1) / count)) < EVEN:
        basis, to_powers = _even_basis(count)
    elif np.max(np.diff(x)) > LONGEST_GAP / count:
        return None
    else:
        basis, to_powers = _basis(x)
    weights = basis.T @ values
    misfit, noise = np.abs(basis @ weights - values), allowed[1]
    if np.max(misfit) > allowed[0] + LARGEST_SCATTER * noise:
        return None
    # Reject a mean square misfit larger than noise explains (chi-square, 2 sd).
    more = 1.0 + 2.0 * np.sqrt(2.0 / misfit.size)
    if np.mean(misfit**2) > allowed[0] ** 2 + more * noise**2:
        return None
    return np.asarray(to_powers @ weights)


def _basis(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal polynomials (M, 6) at `x` (M,) in [0, 1], and their conversion to powers."""
    chebyshev = np.polynomial.chebyshev.chebvander(2.0 * x - 1.0, DEGREE)
    basis, triangle = np.linalg.qr(chebyshev)
    return basis, _CHEBYSHEV_POWERS @ np.linalg.inv(triangle)


@lru_cache(maxsize=256)
def _even_basis(count: int) -> tuple[FloatArray, FloatArray]:
    return _basis(np.arange(count + 1) / count)


FEWEST_KNOTS = 12
"""Fewest knots on one polynomial: twice the number of its coefficients."""
CUT_OFF, COARSE_CUT_OFF = 1e-4, 4e-3
"""Tolerated misfit of a polynomial, in median second differences of the knots. (Straight lines
between knots miss a smooth curve by an eighth of a second difference.) The coarse value applies
to polynomials of the fewest knots, where the other value allows none."""
STEADY = 0.01
"""Change of the voltage on a piece, relative to the peak, up to which it counts as constant."""
JUMP, TURN, WORTH = 0.01, 0.05, 1e-3
"""Thresholds that restart the step size: a jump of the squared voltage, relative to its largest
value; a change of its slope, relative to its largest slope. The change of slope must also change
the squared voltage by the share WORTH within the piece."""


@dataclass(frozen=True)
class Drive:
    """A voltage history in polynomial pieces.

    Attributes
    ----------
    edges : (S + 1,) times at which the pieces begin and end [s].
    coefficients : (S, 6) of the voltage [V], in powers of the elapsed fraction of the piece.
    restart : (S,) 1 where the squared voltage jumps or changes slope at the start of the piece.
    peak : largest magnitude of the voltage at the knots [V].
    """

    edges: FloatArray
    coefficients: FloatArray
    restart: FloatArray
    peak: float

    @cached_property
    def varies(self) -> bool:
        """Whether the voltage changes during more than a twentieth of the time."""
        powers = np.linspace(0.0, 1.0, 9)[:, np.newaxis] ** np.arange(DEGREE + 1)
        change = np.ptp(self.coefficients @ powers.T, axis=1) > STEADY * self.peak
        length = np.diff(self.edges)
        return bool(np.sum(length[change]) > 0.05 * np.sum(length))

    def at(self, time: FloatArray) -> FloatArray:
        """Voltage (N,) [V] at `time` (N,); at a jump, the voltage after the jump."""
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
    """Cut a voltage into pieces; it is constant before its first knot and after its last.

    Parameters
    ----------
    knots, volts : (K,) ascending times [s]; a repeated time marks a jump.
    first, last : times the pieces must span [s].
    tolerance : allowed misfit relative to the peak voltage. A small share of the knots' second
        differences is added to it and, if the knots are `noisy`, their noise.
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
    """Standard deviation of evenly spaced knots about a smooth curve.

    It is 0 for few or unevenly spaced knots, and if it is too large for noise (see `roughness`).
    """
    steps = np.diff(knots)
    middle = float(np.median(steps))
    if knots.size < 4 * FEWEST_KNOTS or np.mean(np.abs(steps - middle) > 0.01 * middle) > 0.2:
        return 0.0
    return roughness(volts)


def _spanning(
    knots: FloatArray, volts: FloatArray, span: tuple[float, float], before: float
) -> tuple[FloatArray, FloatArray]:
    """Extend the knots so that they cover the span and have at least two distinct times."""
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
    """Number of knot intervals of the longest piece from `begin`, and its coefficients.

    Parameters
    ----------
    room : knot intervals from `begin` to the next jump.
    before : knot intervals of the previous piece, which are tried first.
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
        # Leave the last piece enough knots for a polynomial.
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
    """Like `_longest`, for the fewest knots; use knots before `begin` if `room` is too short.

    Parameters
    ----------
    after_jump : index of the first knot after the last jump.
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
    """Return 1 at the start and where the squared voltage jumps or changes slope, else 0."""
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


@dataclass(frozen=True)
class GridSettings:
    """How a graded grid follows a piecewise-linear signal.

    Attributes
    ----------
    first_step : step after a kink [s]; a fraction of the shortest time constant.
    growth : h = first_step + (growth - 1) x time since the kink. Relaxations of every time
        constant are then resolved equally well.
    increment : largest relative change of the signal in a step.
    kink : step after a kink x its change of slope, if the step exceeds first_step: a smaller
        kink allows a larger step. The error of the dense output is then at most about the
        change of slope x the shortest time constant, for a few such time constants.
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
    """Times of steps that end at every knot and are short after every kink.

    Parameters
    ----------
    time, value : (K,) knots, ascending in time; the signal is constant before the first.

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
    """Time since a kink after which the step has grown to `kink` over the change of slope."""
    if change == 0.0:
        return np.inf
    allowed = settings.kink / change - settings.first_step
    return max(0.0, allowed) / (settings.growth - 1.0)


def _fill(
    grid: list[float], end: float, age: float, largest: float, settings: GridSettings
) -> float:
    """Append steps from the grid's last time to `end`; return the time since the kink there."""
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
