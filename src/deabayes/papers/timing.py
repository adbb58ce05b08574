"""What happens when in a record: steps, cycles, loops, sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Excitation, Experiment, FloatArray
from deabayes.integrate.periodic import HYSTERESIS, upward_crossings, usual_period

STEPS = ("step", "creep")
"""Protocols of a voltage that is switched on and stays."""
REACH = 1.2
"""Spacings of a record's points: how far beyond the outer ones a cycle may end."""
GAP = 2.0
"""Times that reach: neighbouring points further apart have a gap between them."""
IntArray = NDArray[np.int64]


def since_step(experiment: Experiment) -> FloatArray:
    """Time of each point since the step (N,) [s]."""
    return np.asarray(experiment.coordinate - experiment.excitation.onset)


def amplitude(excitation: Excitation) -> float:
    """Largest magnitude of the excitation."""
    return float(np.max(np.abs(excitation.values)))


@dataclass(frozen=True)
class Cycles:
    """The whole cycles of a sine within a record.

    Attributes
    ----------
    period : [s].
    starts : (C,) where each starts [s].
    numbers : (C,) which of the sine's cycles each is, from 1.
    """

    period: float
    starts: FloatArray
    numbers: IntArray

    @classmethod
    def of(cls, experiment: Experiment) -> Cycles:
        """Those that the record's points show from end to end.

        As the preparation counted them where its step `cycles` left some of them only, else
        from the excitation. A last cycle counts if the record's points reach its end within
        about their spacing; one with a gap inside does not, as nothing was measured there.
        """
        counted = next((s for s in experiment.steps if s.get("step") == "cycles"), None)
        found = cls.driven(experiment.excitation) if counted is None else cls._counted(counted)
        times = experiment.coordinate
        spacing = REACH * float(np.median(np.diff(times)))
        whole = np.array([_covered(times, s, s + found.period, spacing) for s in found.starts],
                         dtype=bool)  # fmt: skip
        return cls(found.period, found.starts[whole], found.numbers[whole])

    @classmethod
    def driven(cls, drive: Excitation) -> Cycles:
        """From the upward crossings of half the amplitude, of a single sign: of the mid-range.

        A sine through zero starts its cycle there, a twelfth of a period earlier; one of a
        single sign at its lowest magnitude.
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
        """From what the preparation's step `cycles` says it kept: the middle one of each group."""
        sizes = np.asarray(step["group_sizes"], dtype=np.int64)
        before = np.cumsum(sizes) - sizes + sizes // 2
        period = float(str(step["period_s"]))
        starts = np.asarray(float(str(step["first_cycle_s"])) + period * before)
        return cls(period, starts.astype(float), before + 1)

    @property
    def frequency(self) -> float:
        """Of the excitation [Hz]."""
        return 1.0 / self.period

    def times(self, points: int) -> FloatArray:
        """Times (C, points + 1) of evenly spaced phases, both ends included."""
        return np.asarray(self.starts[:, None] + self.period * np.linspace(0.0, 1.0, points + 1))


def as_positive(drive: Excitation) -> Excitation:
    """A drive of negative sign only with its sign turned, any other as it is.

    The Maxwell pressure goes by the square, so the cycle of a motion is that of the magnitude.
    """
    negative = _of_one_sign(-drive.values) and not _of_one_sign(drive.values)
    return replace(drive, values=-drive.values) if negative else drive


def _of_one_sign(values: FloatArray) -> bool:
    """Whether values are positive but for noise, of a tenth of their range at most."""
    return bool(values.min() > -HYSTERESIS * np.ptp(values))


def _covered(times: FloatArray, start: float, end: float, spacing: float) -> bool:
    """Whether points lie all along from `start` to `end`, none further apart than a gap."""
    near = times[(times >= start - spacing) & (times <= end + spacing)]
    reached = near.size > 1 and near[0] <= start + spacing and near[-1] >= end - spacing
    return bool(reached and np.max(np.diff(near)) <= GAP * spacing)


def resampled(coordinate: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """Curves (..., N) at other times, (..., *times.shape), by a cubic spline.

    A record's points are too few per cycle to read a peak or a loop's area from them as they
    stand; measured and predicted curves go through the same spline. It goes on beyond the
    points as far as `Cycles` allows. Points on either side of a gap have splines of their own.
    Curves of nothing but NaN, as of no draw, stay NaN.
    """
    from scipy.interpolate import CubicSpline

    if np.isnan(values).all():
        return np.full((*values.shape[:-1], *times.shape), np.nan)
    spacing = REACH * float(np.median(np.diff(coordinate)))
    gaps = np.flatnonzero(np.diff(coordinate) > GAP * spacing)
    between = 0.5 * (coordinate[gaps] + coordinate[gaps + 1])
    edges = [0, *(gaps + 1).tolist(), coordinate.size]
    part_of = np.searchsorted(between, times, side="right")
    found = np.empty((*values.shape[:-1], *times.shape))
    for part in np.unique(part_of):
        own, at = slice(edges[part], edges[part + 1]), part_of == part
        first, last = coordinate[own][[0, -1]]
        near = np.clip(times[at], first - spacing, last + spacing)
        found[..., at] = CubicSpline(coordinate[own], values[..., own], axis=-1)(near)
    return found


PHASES = 96
STABLE_AREA, STABLE_DRIFT = 0.1, 0.02


class Loops:
    """Displacement (..., C, P + 1) and voltage (C, P + 1) at even phases of each cycle.

    `numbers` (C,) are those of the cycles, from 1; in succession by default.
    """

    def __init__(
        self, displacement: FloatArray, voltage: FloatArray, numbers: IntArray | None = None
    ) -> None:
        self.displacement = displacement
        self.voltage = voltage
        self.numbers = np.arange(1, len(voltage) + 1) if numbers is None else numbers

    @classmethod
    def of(cls, experiment: Experiment, curves: FloatArray, cycles: Cycles) -> Loops:
        """Of a record's curves (..., N)."""
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
        """Number of the first cycle after which nothing changes much per cycle; NaN if none.

        The last cycle alone proves nothing, so it does not count.
        """
        passed = np.diff(self.numbers)
        steady = np.abs(np.diff(self.area)) < STABLE_AREA * passed * np.abs(self.area[1:])
        steady &= np.abs(self.drift[1:]) < STABLE_DRIFT * self.peak_to_peak[1:]
        unsteady = np.flatnonzero(~steady)
        first = int(unsteady[-1]) + 1 if unsteady.size else 0
        return float(self.numbers[first]) if first < passed.size else float("nan")


HARMONICS = 2
FEWEST = 16
"""Points of a window: more than twice its unknowns."""
WORST_CONDITION = 10.0
"""Of a window's harmonics; beyond, the points alias them into each other."""
LEAST_PROMINENCE = 0.02
"""Of a resonance, over the largest amplitude: noise is below."""
SWEEP_PHASES = 97


@dataclass(frozen=True)
class Sweep:
    """Successive windows of whole cycles, as many as have points enough.

    Attributes
    ----------
    frequency : (K,) mean of each window [Hz].
    ends : (K, 2) first and past-the-last point of each window.
    designs : offset, slope, cosines and sines of the voltage's phase at a window's points.
    """

    frequency: FloatArray
    ends: IntArray
    designs: tuple[FloatArray, ...]

    @classmethod
    def of(cls, experiment: Experiment) -> Sweep:
        """The windows of a record whose points can tell the harmonics apart."""
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
        """Peak-to-peak displacement (..., K) of curves (..., N), a drift taken out."""
        phases = _harmonics(np.linspace(0.0, 1.0, SWEEP_PHASES))
        found = []
        for (begin, end), design in zip(self.ends, self.designs, strict=True):
            part = curves[..., begin:end].reshape(-1, end - begin).T
            fit = np.linalg.lstsq(design, part, rcond=None)[0]
            found.append(np.ptp(phases @ fit[2:], axis=0).reshape(curves.shape[:-1]))
        return np.stack(found, axis=-1) if found else np.empty((*curves.shape[:-1], 0))

    def resonance(self, amplitude: FloatArray) -> tuple[float, float]:
        """Frequency [Hz] and height of the most prominent peak of amplitudes (K,), else NaN."""
        from scipy.signal import find_peaks

        peaks, of = find_peaks(amplitude, prominence=LEAST_PROMINENCE * np.max(amplitude))
        if peaks.size == 0:
            return np.nan, np.nan
        top = peaks[np.argmax(of["prominences"])]
        return float(self.frequency[top]), float(amplitude[top])


def _windows(points: IntArray) -> Iterator[tuple[int, int]]:
    """First and last crossing of successive windows with points enough between them."""
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
