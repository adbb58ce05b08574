r"""What an amplifier of limited current puts out when asked for more than it has.

It feeds a series resistance R_S and a capacitance C that leaks through R_L (Sarban et al. 2012,
(4)). As long as the current (u - v_C) / R_S that a command u asks for stays within +-I, the output
is u. At the limit it is v_C +- R_S I, until the command asks for less again:

C v_C' = i - v_C / R_L,   i = (u - v_C) / R_S   or   +-I.

Either is linear. Where the command is linear, what it asks for is a line and an exponential, so
the times at which the limit is met and left are roots in closed brackets; nothing is discretised
but the output at the limit, a slow exponential, which is cut into straight pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, expm1, inf, log, sqrt

import numpy as np

from deabayes.experiment import FloatArray

TOLERANCE = 1e-6
"""Of the largest command: how far straight pieces may stray from the output at the limit."""
SLACK = 1e-3
"""Of that tolerance, by which the limit must be passed before the amplifier is held or let go: else
rounding would do so again and again."""


@dataclass(frozen=True)
class Wave:
    """offset + slope t + swing (exp(-t / time_constant) - 1), for t >= 0."""

    offset: float
    slope: float
    swing: float
    time_constant: float

    def at(self, time: float) -> float:
        return self.offset + self.slope * time + self.swing * expm1(-time / self.time_constant)

    def times(self, factor: float) -> Wave:
        return Wave(
            factor * self.offset, factor * self.slope, factor * self.swing, self.time_constant
        )

    def nodes(self, length: float, tolerance: float) -> list[float]:
        """Where to bend a polyline that stays this close to it for so long, ends left out.

        The error of a piece is its squared length times the curvature over 8, so their density
        goes with the root of the curvature.
        """
        decayed = -expm1(-0.5 * length / self.time_constant)
        count = max(ceil(2.0 * decayed * sqrt(abs(self.swing) / (8.0 * tolerance))), 1)
        left = (1.0 - decayed * piece / count for piece in range(1, count))
        return [-2.0 * self.time_constant * log(share) for share in left]

    def first_above(self, level: float, length: float) -> float:
        """The first time in [0, length] from which on it is above a level; infinity if none."""
        from scipy.optimize import brentq

        if self.at(0.0) > level:
            return 0.0
        share = self.slope * self.time_constant / self.swing if self.swing else inf
        turn = -self.time_constant * log(share) if 0.0 < share < 1.0 else inf
        ends = [0.0, turn, length] if turn < length else [0.0, length]
        for left, right in pairwise(ends):
            if self.at(right) > level:
                return float(brentq(lambda t: self.at(t) - level, left, right, xtol=1e-15))
        return inf


@dataclass(frozen=True)
class Amplifier:
    """Its current limit I [A], and what it feeds: R_S, R_L [ohm] and C [F], all positive."""

    limit: float
    series_resistance: float
    leakage_resistance: float
    capacitance: float

    def output(
        self, time: FloatArray, command: FloatArray
    ) -> tuple[list[float], list[float], float]:
        """The output's knots: times and values [V]; and for how long it was at the limit [s].

        Linear between them, as the command is between `time` (K,), a repeated time being a
        jump. Without charge until the command begins.
        """
        charge = _Charge(self, TOLERANCE * float(np.max(np.abs(command))) or 1.0)
        for start, end, first, last in zip(time, time[1:], command, command[1:], strict=False):
            charge.follow(float(start), float(end), float(first), float(last))
        return charge.times, charge.values, charge.limited


class _Charge:
    """v_C on its way, with what the amplifier has put out so far."""

    def __init__(self, amplifier: Amplifier, tolerance: float) -> None:
        self.amplifier, self.tolerance = amplifier, tolerance
        self.charged, self.side, self.limited = 0.0, 0, 0.0
        self.times, self.values = list[float](), list[float]()
        self._most = amplifier.limit * amplifier.series_resistance
        self._slack = SLACK * tolerance

    def follow(self, start: float, end: float, first: float, last: float) -> None:
        """A command that goes from `first` to `last`; a jump leaves the charge alone."""
        if end <= start:
            self._put(end, last)
            return
        length, passed = end - start, 0.0
        slope = (last - first) / length
        self._put(start, first)
        while passed < length:
            asked, charge = self._waves(first + slope * passed, slope)
            span, side = self._held_for(asked, length - passed)
            if self.side:
                self.limited += span
                for after in charge.nodes(span, self.tolerance):
                    output = self.charged + charge.at(after) + self.side * self._most
                    self._enter(start + passed + after, output)
            self.charged += charge.at(span)
            self.side = side
            passed = length if span >= length - passed else passed + span
            at_end = passed == length
            self._put(end if at_end else start + passed, last if at_end else first + slope * passed)

    def _waves(self, command: float, slope: float) -> tuple[Wave, Wave]:
        """u - v_C from now on, and by how much v_C changes."""
        a = self.amplifier
        if self.side:
            constant = a.leakage_resistance * a.capacitance
            swing = self.charged - self.side * a.limit * a.leakage_resistance
            return (
                Wave(command - self.charged, slope, -swing, constant),
                Wave(0.0, 0.0, swing, constant),
            )
        gain = a.leakage_resistance / (a.leakage_resistance + a.series_resistance)
        constant = gain * a.series_resistance * a.capacitance
        swing = self.charged - gain * (command - slope * constant)
        return (
            Wave(command - self.charged, (1.0 - gain) * slope, -swing, constant),
            Wave(0.0, gain * slope, swing, constant),
        )

    def _held_for(self, asked: Wave, length: float) -> tuple[float, int]:
        """For how long the amplifier stays on its side of the limit, and the side after that."""
        if self.side:
            free = asked.times(-self.side).first_above(self._slack - self._most, length)
            return (free, 0) if free < length else (length, self.side)
        over = [asked.times(s).first_above(self._most + self._slack, length) for s in (1, -1)]
        if min(over) >= length:
            return length, 0
        return min(over), 1 if over[0] < over[1] else -1

    def _put(self, time: float, command: float) -> None:
        """Enter the output now: the command, or what the limit leaves of it."""
        asked = command - self.charged
        held = min(max(asked, -self._most), self._most)
        self._enter(time, self.charged + held)

    def _enter(self, time: float, value: float) -> None:
        if not (self.times and self.times[-1] == time and self.values[-1] == value):
            self.times.append(time)
            self.values.append(value)
