"""Means of a periodic record at equal phases, and how they drift from cycle to cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.preparation.periods import Cycles
from deabayes.preparation.working import IntArray, WorkingRecord

ROUNDING = 1e-6
SEEN = 4.0
"""Standard errors above which a change over cycles is one."""


@dataclass(frozen=True)
class WindowMeans:
    """Mean time and response, and number of samples, in each window of each cycle, (C, P).

    `variance` is that of the times in a window. NaN where a window holds no visible sample.
    """

    coordinate: FloatArray
    response: FloatArray
    samples: FloatArray
    variance: FloatArray


def window_means(record: WorkingRecord, found: Cycles, points: int, window: float) -> WindowMeans:
    """Average the visible samples in the middle `window` of each of `points` bins per cycle."""
    visible = np.flatnonzero(record.used)
    place = (record.coordinate[visible] - found.start) / found.period * points
    bins = np.floor(place).astype(np.intp)
    # Half open, a little early: whether a sample stands on an edge is no matter of rounding.
    offset = place - bins - 0.5 + ROUNDING
    near = (offset >= -0.5 * window) & (offset < 0.5 * window)
    near &= (bins >= 0) & (bins < found.count * points)
    visible, bins = visible[near], bins[near]
    weights = record.samples_averaged[visible]

    def total(values: FloatArray) -> FloatArray:
        sums = np.bincount(bins, weights * values, minlength=found.count * points)
        return np.asarray(sums.reshape(found.count, points), dtype=np.float64)

    samples = total(np.ones(visible.size))
    samples[samples == 0.0] = np.nan
    mean = total(record.coordinate[visible]) / samples
    away = record.coordinate[visible] - mean.ravel()[bins]
    return WindowMeans(
        mean, total(record.response[visible]) / samples, samples, total(away**2) / samples
    )


def drift(means: WindowMeans, group: IntArray) -> float:
    """By how much the response at any phase changes from the first to the last cycle of a group.

    From the slopes of lines through the cycles at each phase.
    """
    number = group - group.mean()
    return _largest(means, group, number) * (group.size - 1)


def off_middle(means: WindowMeans, group: IntArray) -> float:
    """By how much the mean over a group is off its middle cycle, at any phase.

    From parabolas a + b n + c n^2 through the G cycles at each phase, n counted from the middle:
    c (G^2 - 1) / 12, as b cancels. Of a group of three it is the difference itself.
    """
    square = (group - group.mean()) ** 2
    return _largest(means, group, square - square.mean()) * float(square.mean())


def _largest(means: WindowMeans, group: IntArray, pattern: FloatArray) -> float:
    """The largest coefficient of a pattern over the cycles of a group, fitted at each phase.

    Of the coefficients the mean and the first harmonic over phases are taken: noise of single
    windows is none. Zero within four standard errors.
    """
    whole = np.flatnonzero(np.all(np.isfinite(means.samples[group]), axis=0))
    norm = float(pattern @ pattern)
    if norm == 0.0 or whole.size < 8:
        return 0.0
    fitted = pattern @ means.response[group][:, whole] / norm
    phase = 2.0 * np.pi * whole / means.samples.shape[1]
    basis = np.column_stack([np.ones(whole.size), np.cos(phase), np.sin(phase)])
    smooth = basis @ np.linalg.lstsq(basis, fitted, rcond=None)[0]
    free = whole.size - basis.shape[1]
    error = np.sqrt(np.sum((fitted - smooth) ** 2) / free * basis.shape[1] / whole.size)
    largest = float(np.max(np.abs(smooth)))
    return largest if largest > SEEN * error else 0.0
