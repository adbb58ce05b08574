"""What happens when in a record that is driven in time: the step, the cycles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

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
