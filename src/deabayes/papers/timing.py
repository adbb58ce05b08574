"""Timing within a record: steps, cycles, loops and sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.integrate.periodic import HYSTERESIS, upward_crossings, usual_period

STEPS = ("step", "creep")
"""Protocols in which the voltage is switched on and stays constant."""
REACH = 1.2
"""Distance, in point spacings, that a cycle may extend beyond the outer points of a record."""
GAP = 2.0
"""Points further apart than `GAP` times `REACH` spacings have a gap between them."""
IntArray = NDArray[np.int64]
PHASES = 96
STABLE_AREA, STABLE_DRIFT = 0.1, 0.02
HARMONICS = 2
FEWEST = 16
"""Smallest number of points in a window, more than twice its unknowns."""
WORST_CONDITION = 10.0
"""Largest condition number of a window's design; above it the points alias the harmonics."""
LEAST_PROMINENCE = 0.02
"""Smallest prominence of a resonance over the largest amplitude; noise stays below it."""
SWEEP_PHASES = 97


def since_step(experiment: Experiment) -> FloatArray:
    """Time of each point since the step (N,) [s]."""
    return np.asarray(experiment.coordinate - experiment.excitation.onset)


def amplitude(excitation: Excitation) -> float:
    """Largest magnitude of the excitation."""
    return float(np.max(np.abs(excitation.values)))


def near(value: float, printed: float, tolerance: float = 0.02) -> bool:
    """Whether a record's voltage or frequency equals a printed value within `tolerance`."""
    return abs(value - printed) <= tolerance * printed


@dataclass(frozen=True)
class Cycles:
    """Whole cycles of a sine within a record.

    Attributes
    ----------
    period : of the sine [s].
    starts : (C,) start of each cycle [s].
    numbers : (C,) number of each cycle within the sine, from 1.
    """

    period: float
    starts: FloatArray
    numbers: IntArray

    @classmethod
    def of(cls, experiment: Experiment) -> Cycles:
        """Return the cycles that the record's points cover from start to end.

        If the preparation's step `cycles` kept some cycles, its counts are used. Otherwise the
        cycles come from the excitation. A cycle counts if points reach its start and end within
        `REACH` spacings. A cycle with a gap inside does not count.
        """
        counted = next((s for s in experiment.steps if s.get("step") == "cycles"), None)
        cycles = cls.driven(experiment.excitation) if counted is None else cls._counted(counted)
        times = experiment.coordinate
        spacing = REACH * float(np.median(np.diff(times)))
        whole = np.array([_covered(times, s, s + cycles.period, spacing) for s in cycles.starts],
                         dtype=bool)  # fmt: skip
        return cls(cycles.period, cycles.starts[whole], cycles.numbers[whole])

    @classmethod
    def driven(cls, drive: Excitation) -> Cycles:
        """Return the cycles found from upward crossings of the excitation.

        For a sine of both signs the level is half the amplitude. Its cycle starts at zero, a
        twelfth of a period before the crossing. For a sine of one sign the level is the
        mid-range. Its cycle starts at the lowest magnitude.
        """
        drive = as_positive(drive)
        level = float(np.quantile([drive.values.min(), drive.values.max()], 0.75))
        if single := _of_one_sign(drive.values):
            level = 0.5 * float(drive.values.max() + drive.values.min())
        crossings = upward_crossings(drive.coordinate, drive.values, level)
        if crossings.size < 2:
            return cls(np.nan, np.array([]), np.array([], dtype=np.int64))
        period, early = usual_period(crossings), 1.0 / 12.0
        if single:
            driven = drive.values[drive.coordinate >= crossings[0]]
            middle, half = 0.5 * (driven.max() + driven.min()), 0.5 * float(np.ptp(driven))
            early = 0.25 + float(np.arcsin((level - middle) / half)) / (2.0 * np.pi)
        return cls(period, crossings - early * period, np.arange(1, crossings.size + 1))

    @classmethod
    def _counted(cls, step: Mapping[str, object]) -> Cycles:
        """Return the cycles that the preparation kept: the middle one of each averaged group."""
        sizes = np.asarray(step["group_sizes"], dtype=np.int64)
        before = np.cumsum(sizes) - sizes + sizes // 2
        period = float(str(step["period_s"]))
        starts = np.asarray(float(str(step["first_cycle_s"])) + period * before)
        return cls(period, starts.astype(float), before + 1)

    @property
    def frequency(self) -> float:
        """Frequency of the excitation [Hz]."""
        return 1.0 / self.period

    def times(self, points: int) -> FloatArray:
        """Times (C, points + 1) of evenly spaced phases, both ends included."""
        return np.asarray(self.starts[:, None] + self.period * np.linspace(0.0, 1.0, points + 1))


def as_positive(drive: Excitation) -> Excitation:
    """Return a purely negative drive with its sign reversed, any other drive unchanged.

    The Maxwell pressure depends on the squared voltage, so the motion follows the magnitude.
    """
    negative = _of_one_sign(-drive.values) and not _of_one_sign(drive.values)
    return replace(drive, values=-drive.values) if negative else drive


def _of_one_sign(values: FloatArray) -> bool:
    """Whether values are positive, apart from noise of at most a tenth of their range."""
    return bool(values.min() > -HYSTERESIS * np.ptp(values))


def _covered(times: FloatArray, start: float, end: float, spacing: float) -> bool:
    """Whether points cover the time from `start` to `end` without a gap."""
    near = times[(times >= start - spacing) & (times <= end + spacing)]
    reached = near.size > 1 and near[0] <= start + spacing and near[-1] >= end - spacing
    return bool(reached and np.max(np.diff(near)) <= GAP * spacing)


def resampled(coordinate: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate curves (..., N) at other times by a cubic spline, (..., *times.shape).

    A record has too few points per cycle to read a peak or a loop's area from them directly.
    Measured and predicted curves use the same spline. The spline extends beyond the points as
    far as `Cycles` allows. Points on the two sides of a gap have separate splines. If all values
    are NaN, the result is NaN.
    """
    from scipy.interpolate import CubicSpline

    if np.isnan(values).all():
        return np.full((*values.shape[:-1], *times.shape), np.nan)
    spacing = REACH * float(np.median(np.diff(coordinate)))
    gaps = np.flatnonzero(np.diff(coordinate) > GAP * spacing)
    between = 0.5 * (coordinate[gaps] + coordinate[gaps + 1])
    edges = [0, *(gaps + 1).tolist(), coordinate.size]
    part_of = np.searchsorted(between, times, side="right")
    curves = np.empty((*values.shape[:-1], *times.shape))
    for part in np.unique(part_of):
        own, at = slice(edges[part], edges[part + 1]), part_of == part
        first, last = coordinate[own][[0, -1]]
        near = np.clip(times[at], first - spacing, last + spacing)
        curves[..., at] = CubicSpline(coordinate[own], values[..., own], axis=-1)(near)
    return curves


class Loops:
    """Displacement (..., C, P + 1) and voltage (C, P + 1) at even phases of each cycle.

    `numbers` (C,) are the numbers of the cycles, by default 1, 2, ..., C.
    """

    def __init__(
        self, displacement: FloatArray, voltage: FloatArray, numbers: IntArray | None = None
    ) -> None:
        self.displacement = displacement
        self.voltage = voltage
        self.numbers = np.arange(1, len(voltage) + 1) if numbers is None else numbers

    @classmethod
    def of(cls, experiment: Experiment, curves: FloatArray, cycles: Cycles) -> Loops:
        """Return the loops of a record's curves (..., N)."""
        times = cycles.times(PHASES)
        moved = resampled(experiment.coordinate, curves, times)
        return cls(moved, experiment.excitation.at(times), cycles.numbers)

    @cached_property
    def area(self) -> FloatArray:
        """-∮ u d|Phi| of each cycle (..., C) [V m]."""
        u, volts = self.displacement, np.abs(self.voltage)
        return np.asarray(-np.sum(0.5 * (u[..., 1:] + u[..., :-1]) * np.diff(volts), axis=-1))

    @cached_property
    def mean(self) -> FloatArray:
        """Mean displacement of each cycle (..., C) [m]."""
        return np.asarray(np.mean(self.displacement[..., :-1], axis=-1))

    @cached_property
    def peak_to_peak(self) -> FloatArray:
        """Largest minus smallest displacement of each cycle (..., C) [m]."""
        return np.asarray(np.ptp(self.displacement, axis=-1))

    @cached_property
    def drift(self) -> FloatArray:
        """Change of the mean per cycle since the cycle before (..., C) [m]; NaN for the first."""
        change = np.diff(self.mean, axis=-1) / np.diff(self.numbers)
        return np.concatenate([np.full_like(self.mean[..., :1], np.nan), change], axis=-1)

    def stable_from(self) -> float:
        """Number of the first cycle after which the loops are stable; NaN if there is none.

        Loops are stable if, per cycle, the area changes by less than `STABLE_AREA` of its value
        and the mean by less than `STABLE_DRIFT` of the peak-to-peak displacement. The last cycle
        cannot be tested, so it does not count.
        """
        passed = np.diff(self.numbers)
        steady = np.abs(np.diff(self.area)) < STABLE_AREA * passed * np.abs(self.area[1:])
        steady &= np.abs(self.drift[1:]) < STABLE_DRIFT * self.peak_to_peak[1:]
        unsteady = np.flatnonzero(~steady)
        first = int(unsteady[-1]) + 1 if unsteady.size else 0
        return float(self.numbers[first]) if first < passed.size else float("nan")


@dataclass(frozen=True)
class Sweep:
    """Successive windows of whole cycles along a sweep, each with at least `FEWEST` points.

    Attributes
    ----------
    frequency : (K,) mean frequency of each window [Hz].
    ends : (K, 2) first and past-the-last point of each window.
    designs : regressors at each window's points: offset, slope, cosines and sines of the
        voltage's phase.
    """

    frequency: FloatArray
    ends: IntArray
    designs: tuple[FloatArray, ...]

    @classmethod
    def of(cls, experiment: Experiment) -> Sweep:
        """Return the windows in which the record's points can separate the harmonics."""
        drive, times = experiment.excitation, experiment.coordinate
        middle = 0.5 * (drive.values.max() + drive.values.min())
        crossings = upward_crossings(drive.coordinate, drive.values, float(middle))
        turns = np.interp(times, crossings, np.arange(crossings.size, dtype=float))
        points = np.searchsorted(times, crossings)
        frequencies, ends, designs = [], [], []
        for first, last in _windows(points):
            design = _design(turns[points[first] : points[last]])
            if np.linalg.cond(design / np.linalg.norm(design, axis=0)) < WORST_CONDITION:
                frequencies.append((last - first) / (crossings[last] - crossings[first]))
                ends.append((points[first], points[last]))
                designs.append(design)
        return cls(np.array(frequencies), np.array(ends).reshape(-1, 2), tuple(designs))

    def amplitude(self, curves: FloatArray) -> FloatArray:
        """Peak-to-peak displacement (..., K) of curves (..., N), without drift."""
        phases = _harmonics(np.linspace(0.0, 1.0, SWEEP_PHASES))
        amplitudes = []
        for (begin, end), design in zip(self.ends, self.designs, strict=True):
            part = curves[..., begin:end].reshape(-1, end - begin).T
            fit = np.linalg.lstsq(design, part, rcond=None)[0]
            amplitudes.append(np.ptp(phases @ fit[2:], axis=0).reshape(curves.shape[:-1]))
        return np.stack(amplitudes, axis=-1) if amplitudes else np.empty((*curves.shape[:-1], 0))

    def resonance(self, amplitude: FloatArray) -> tuple[float, float]:
        """Frequency [Hz] and height of the most prominent peak of amplitudes (K,); NaN if none."""
        from scipy.signal import find_peaks

        peaks, of = find_peaks(amplitude, prominence=LEAST_PROMINENCE * np.max(amplitude))
        if peaks.size == 0:
            return np.nan, np.nan
        top = peaks[np.argmax(of["prominences"])]
        return float(self.frequency[top]), float(amplitude[top])


def _windows(points: IntArray) -> Iterator[tuple[int, int]]:
    """Yield first and last crossing of successive windows of at least `FEWEST` points."""
    first = 0
    for last in range(1, points.size):
        if points[last] - points[first] >= FEWEST:
            yield first, last
            first = last


def _harmonics(turns: FloatArray) -> FloatArray:
    angles = 2.0 * np.pi * turns[:, None] * np.arange(1, HARMONICS + 1)
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=1)


def _design(turns: FloatArray) -> FloatArray:
    along = np.linspace(-1.0, 1.0, turns.size)
    return np.column_stack([np.ones_like(along), along, _harmonics(turns)])
