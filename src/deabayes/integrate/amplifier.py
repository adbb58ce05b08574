r"""Output of an amplifier of limited current when the command needs more current.

The amplifier feeds a series resistance R_S and a capacitance C that leaks through R_L (Sarban et
al. 2012, (4)). A command u needs the current (u - v_C) / R_S. While this current is within +-I,
the output is u. At the limit the output is v_C +- R_S I, until the command needs less again:

C v_C' = i - v_C / R_L,   i = (u - v_C) / R_S   or   +-I.

Both laws are linear. For a linear command, u - v_C is a line plus an exponential. The times at
which the limit is reached and left are therefore bracketed roots. Only the output at the limit, a
slow exponential, is discretised: it is cut into straight pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, expm1, inf, log, sqrt

import numpy as np

from deabayes.experiment import FloatArray

TOLERANCE = 1e-6
"""Largest error of the straight pieces at the limit, relative to the largest command."""
SLACK = 1e-3
"""Share of the tolerance by which the limit must be passed before it starts or ends. Without this
margin, rounding would start and end it again and again."""


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
        """Inner nodes of a polyline that stays within `tolerance` of the wave over `length`.

        The error of a piece is its squared length times the curvature over 8. The density of
        the nodes is therefore proportional to the square root of the curvature.
        """
        decayed = -expm1(-0.5 * length / self.time_constant)
        count = max(ceil(2.0 * decayed * sqrt(abs(self.swing) / (8.0 * tolerance))), 1)
        left = (1.0 - decayed * piece / count for piece in range(1, count))
        return [-2.0 * self.time_constant * log(share) for share in left]

    def first_above(self, level: float, length: float) -> float:
        """First time in [0, length] at which the wave exceeds `level`; infinity if never."""
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
    """An amplifier of current limit I [A] and its load R_S, R_L [ohm] and C [F], all positive."""

    limit: float
    series_resistance: float
    leakage_resistance: float
    capacitance: float

    def output(
        self, time: FloatArray, command: FloatArray
    ) -> tuple[list[float], list[float], float]:
        """Times and values [V] of the output's knots, and the total time at the limit [s].

        The output is linear between its knots, and the command between `time` (K,). A repeated
        time is a jump. The capacitance is uncharged until the command begins.
        """
        charge = _Charge(self, TOLERANCE * float(np.max(np.abs(command))) or 1.0)
        for start, end, first, last in zip(time, time[1:], command, command[1:], strict=False):
            charge.follow(float(start), float(end), float(first), float(last))
        return charge.times, charge.values, charge.limited


class _Charge:
    """The evolving voltage v_C, and the output of the amplifier so far."""

    def __init__(self, amplifier: Amplifier, tolerance: float) -> None:
        self.amplifier, self.tolerance = amplifier, tolerance
        self.charged, self.side, self.limited = 0.0, 0, 0.0
        self.times, self.values = list[float](), list[float]()
        self._most = amplifier.limit * amplifier.series_resistance
        self._slack = SLACK * tolerance

    def follow(self, start: float, end: float, first: float, last: float) -> None:
        """Follow a command that is linear from `first` to `last`; a jump does not change v_C."""
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
        """Return u - v_C from now on, and the change of v_C from now on."""
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
        """Time, at most `length`, until the limit starts or ends, and the side after that."""
        if self.side:
            free = asked.times(-self.side).first_above(self._slack - self._most, length)
            return (free, 0) if free < length else (length, self.side)
        over = [asked.times(s).first_above(self._most + self._slack, length) for s in (1, -1)]
        if min(over) >= length:
            return length, 0
        return min(over), 1 if over[0] < over[1] else -1

    def _put(self, time: float, command: float) -> None:
        """Enter the output at `time`: the command, clipped to what the current limit allows."""
        asked = command - self.charged
        held = min(max(asked, -self._most), self._most)
        self._enter(time, self.charged + held)

    def _enter(self, time: float, value: float) -> None:
        if not (self.times and self.times[-1] == time and self.values[-1] == value):
            self.times.append(time)
            self.values.append(value)
