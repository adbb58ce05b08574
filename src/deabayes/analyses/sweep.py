"""Amplitudes along a sweep, from the phase of its voltage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from deabayes.analyses.drive import IntArray
from deabayes.experiment import Experiment, FloatArray
from deabayes.integrate.periodic import upward_crossings

HARMONICS = 2
FEWEST = 16
"""Points of a window: more than twice its unknowns."""
WORST_CONDITION = 10.0
"""Of a window's harmonics; beyond, the points alias them into each other."""
LEAST_PROMINENCE = 0.02
"""Of a resonance, over the largest amplitude: noise is below."""
PHASES = 97


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
        phases = _harmonics(np.linspace(0.0, 1.0, PHASES))
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
