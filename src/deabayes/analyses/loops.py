"""The response against the voltage in each cycle of a sine: loops, their area, when they settle."""

from __future__ import annotations

import numpy as np

from deabayes.analyses.drive import Cycles, resampled
from deabayes.experiment import Experiment, FloatArray

PHASES = 96
STABLE_AREA, STABLE_DRIFT = 0.1, 0.02


class Loops:
    """Displacement (..., C, P + 1) and voltage (C, P + 1) at even phases of each cycle."""

    def __init__(self, displacement: FloatArray, voltage: FloatArray) -> None:
        self.displacement = displacement
        self.voltage = voltage

    @classmethod
    def of(cls, experiment: Experiment, curves: FloatArray, cycles: Cycles) -> Loops:
        """Of a record's curves (..., N)."""
        times = cycles.times(PHASES)
        return cls(resampled(experiment.coordinate, curves, times), experiment.excitation.at(times))

    @property
    def area(self) -> FloatArray:
        """-∮ u d|Phi| of each cycle (..., C) [V m]."""
        u, volts = self.displacement, np.abs(self.voltage)
        return np.asarray(-np.sum(0.5 * (u[..., 1:] + u[..., :-1]) * np.diff(volts), axis=-1))

    @property
    def mean(self) -> FloatArray:
        """Mean displacement of each cycle (..., C) [m]."""
        return np.asarray(np.mean(self.displacement[..., :-1], axis=-1))

    @property
    def peak_to_peak(self) -> FloatArray:
        """Largest minus smallest displacement of each cycle (..., C) [m]."""
        return np.asarray(np.ptp(self.displacement, axis=-1))

    def stable_from(self) -> float:
        """Number of the first cycle (from 1) after which nothing changes much; NaN if none.

        The last cycle alone proves nothing, so it does not count.
        """
        area, mean = self.area, self.mean
        steady = np.abs(np.diff(area)) < STABLE_AREA * np.abs(area[1:])
        steady &= np.abs(np.diff(mean)) < STABLE_DRIFT * self.peak_to_peak[1:]
        unsteady = np.flatnonzero(~steady)
        first = int(unsteady[-1]) + 2 if unsteady.size else 1
        return float(first) if first < area.size else float("nan")
