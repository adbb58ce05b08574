"""The response against the voltage in each cycle of a sine: loops, their area, when they settle."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from deabayes.analyses.drive import Cycles, IntArray, resampled
from deabayes.experiment import Experiment, FloatArray

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
