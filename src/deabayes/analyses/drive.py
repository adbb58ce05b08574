"""What happens when in a record that is driven in time: the step, the cycles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray

STEPS = ("step", "creep")
"""Protocols of a voltage that is switched on and stays."""
REACH = 1.2
"""Spacings of a record's points: how far beyond the outer ones a cycle may end."""


def since_step(experiment: Experiment) -> FloatArray:
    """Time of each point since the step (N,) [s]."""
    return np.asarray(experiment.coordinate - experiment.excitation.onset)


def amplitude(excitation: Excitation) -> float:
    """Largest magnitude of the excitation."""
    return float(np.max(np.abs(excitation.values)))


@dataclass(frozen=True)
class Cycles:
    """The whole cycles of a sine within a record: their period and where each starts (C,) [s]."""

    period: float
    starts: FloatArray

    @classmethod
    def of(cls, experiment: Experiment) -> Cycles:
        """From the upward crossings of half the amplitude, a twelfth of a period after the start.

        A last cycle counts if the record's points reach its end within about their spacing.
        """
        drive, level = experiment.excitation, 0.5 * amplitude(experiment.excitation)
        below = (drive.values[:-1] < level) & (drive.values[1:] >= level)
        first = np.flatnonzero(below)
        rise = np.diff(drive.values)[first]
        width = np.diff(drive.coordinate)[first]
        crossings = drive.coordinate[first] + (level - drive.values[first]) / rise * width
        if crossings.size < 2:
            return cls(np.nan, np.array([]))
        period = float(np.median(np.diff(crossings)))
        starts = crossings - period / 12.0
        times = experiment.coordinate
        spacing = REACH * float(np.median(np.diff(times)))
        whole = (starts >= times[0] - spacing) & (starts + period <= times[-1] + spacing)
        return cls(period, starts[whole])

    @property
    def frequency(self) -> float:
        """Of the excitation [Hz]."""
        return 1.0 / self.period

    def times(self, points: int) -> FloatArray:
        """Times (C, points + 1) of evenly spaced phases, both ends included."""
        return np.asarray(self.starts[:, None] + self.period * np.linspace(0.0, 1.0, points + 1))


def resampled(coordinate: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """Curves (..., N) at other times, (..., *times.shape), by a cubic spline.

    A record's points are too few per cycle to read a peak or a loop's area from them as they
    stand; measured and predicted curves go through the same spline. It goes on beyond the
    points as far as `Cycles` allows.
    """
    from scipy.interpolate import CubicSpline

    spacing = REACH * float(np.median(np.diff(coordinate)))
    near = np.clip(times, coordinate[0] - spacing, coordinate[-1] + spacing)
    return np.asarray(CubicSpline(coordinate, values, axis=-1)(near))
