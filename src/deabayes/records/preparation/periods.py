"""Periods of an excitation, and means of a periodic record at equal phases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.integrate.periodic import HYSTERESIS, alike, passes, steady, usual_period
from deabayes.records.preparation.working import IntArray, WorkingRecord

FEWEST_CYCLES = 3
STATED_WITHIN = 0.01
LEAD = 0.05
PHASES = 200
UNLIKE = 0.02
INSTEAD = "use `average` for a sweep, a step or a few cycles"


@dataclass(frozen=True)
class Cycles:
    """Complete cycles of a record: `count` cycles of length `period`, from `start` on."""

    start: float
    period: float
    count: int

    @property
    def end(self) -> float:
        return self.start + self.count * self.period


def found_period(record: WorkingRecord, where: str) -> float:
    """Return the excitation's period, from the steady stretch of its passes (`usual_period`).

    Raises
    ------
    UserError : the excitation is a step or a sweep, or has fewer than three cycles.
    """
    times = passes(record.excitation_coordinate, record.excitation)
    if times.size < FEWEST_CYCLES:
        raise UserError(
            f"{where}: the {record.row.excitation} passes the middle of its range {times.size} "
            f"times, so it does not have {FEWEST_CYCLES} cycles; {INSTEAD}"
        )
    stretch = steady(times)
    if stretch.size < FEWEST_CYCLES or np.mean(alike(times)) < 0.5:
        gaps = np.diff(times)
        raise UserError(
            f"{where}: the {record.row.excitation} is not periodic, it passes the middle of its "
            f"range every {gaps.min():.4g} to {gaps.max():.4g} s; {INSTEAD}, or give `frequency`"
        )
    return usual_period(stretch)


def check_stated(period: float, record: WorkingRecord, where: str) -> None:
    """Check that the row's `frequency_Hz`, if given, agrees with the excitation."""
    stated = record.row.metadata.get("frequency_Hz")
    if not isinstance(stated, int | float) or not np.isfinite(stated):
        return
    if abs(stated * period - 1.0) > STATED_WITHIN:
        raise UserError(
            f"{where}: the {record.row.excitation} has {1.0 / period:.6g} Hz, experiments.csv says "
            f"frequency_Hz {stated:g}; correct it, or the record's time"
        )


def whole_cycles(record: WorkingRecord, period: float, transition: int, where: str) -> Cycles:
    """Return the complete cycles of the visible response while the excitation is periodic.

    The first cycle begins at the first visible sample or, if later, a twentieth of a period
    before the excitation leaves its first value, because a smooth start is detected late. It
    begins at most one period before the first pass, because noise at rest may look like a start.
    A last cycle counts as complete if the record ends within a sampling interval of its end.
    Nothing counts after the excitation has stopped repeating itself.

    Raises
    ------
    UserError : fewer than three cycles, or cycles after the transition that differ.
    """
    visible = record.coordinate[record.used]
    half = 0.5 * float(np.median(np.diff(record.coordinate)))
    times = passes(record.excitation_coordinate, record.excitation)
    first, last = (float(times[0]), float(times[-1])) if times.size else (-np.inf, -np.inf)
    onset = max(record.excitation_start() - LEAD * period, first - period)
    start = max(float(visible[0]), onset)
    lasting = (visible[-1] + 3.0 * half - start) / period
    driven = (last - start) / period + 1.0 if times.size else 0.0
    cycles = Cycles(start, period, max(int(min(lasting, driven)), 0))
    if cycles.count > transition:
        cycles = _alike(cycles, record, transition, last, where)
    if cycles.count < FEWEST_CYCLES:
        raise UserError(
            f"{where}: {cycles.count} whole cycles of {period:.6g} s are visible, at least "
            f"{FEWEST_CYCLES} are needed; mask less of the record, or {INSTEAD}"
        )
    _check_rest_after(cycles, record, float(visible[-1]), where)
    return cycles


def _check_rest_after(cycles: Cycles, record: WorkingRecord, last: float, where: str) -> None:
    """Check that the excitation rests after its last cycle, up to the last visible sample."""
    times = record.excitation_coordinate
    after = record.excitation[(times > cycles.end + cycles.period) & (times <= last)]
    if after.size and np.ptp(after) > HYSTERESIS * np.ptp(record.excitation):
        raise UserError(
            f"{where}: the {record.row.excitation} repeats itself every {cycles.period:.6g} s only "
            f"until {cycles.end:.6g} s and goes on otherwise; put "
            f"`crop: {{to: {cycles.end:.6g} s}}` before this step, or {INSTEAD}"
        )


def _alike(
    cycles: Cycles, record: WorkingRecord, transition: int, last_pass: float, where: str
) -> Cycles:
    """Drop the cycles in which the excitation ends; check that the other cycles are alike."""
    away = departures(cycles, record, transition)
    unlike = transition + np.flatnonzero(away > UNLIKE)
    ending = cycles.start + (unlike + 1) * cycles.period >= last_pass
    if unlike.size and np.all(ending):
        return Cycles(cycles.start, cycles.period, int(unlike[0]))
    if unlike.size == 0:
        return cycles
    first = int(unlike[0])
    raise UserError(
        f"{where}: the {record.row.excitation} does not repeat itself every {cycles.period:.6g} s: "
        f"cycle {first + 1}, from {cycles.start + first * cycles.period:.6g} s, differs from the "
        f"others by {away[first - transition]:.1%} of their range on average; {INSTEAD}, raise "
        "`transition` if it settles later, or give the right `frequency`"
    )


def departures(cycles: Cycles, record: WorkingRecord, first: int) -> FloatArray:
    """Difference of each cycle of the excitation, from cycle `first` on, from the median cycle.

    This is the mean absolute difference over a cycle as a share of the range. A phase error of
    1 % of a period, or an amplitude error of 6 %, gives 2 %.
    """
    number = np.arange(first, cycles.count)[:, None]
    times = cycles.start + (number + (np.arange(PHASES) + 0.5) / PHASES) * cycles.period
    folded = np.interp(times, record.excitation_coordinate, record.excitation)
    usual = np.median(folded, axis=0)
    size = float(np.ptp(usual)) or 1.0
    return np.asarray(np.abs(folded - usual).mean(axis=1) / size)


ROUNDING = 1e-6
SEEN = 4.0
"""Number of standard errors above which a change over cycles is significant."""


@dataclass(frozen=True)
class WindowMeans:
    """Mean time, mean response and number of samples per window, (C cycles, P points).

    `variance` is the variance of the times in a window. Values are NaN if a window holds no
    visible sample.
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
    # Half-open windows, shifted slightly: rounding then cannot decide about a sample on an edge.
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
    """Largest change of the response, at any phase, from the first to the last cycle of a group.

    It follows from the slopes of lines fitted through the cycles at each phase.
    """
    number = group - group.mean()
    return _largest(means, group, number) * (group.size - 1)


def off_middle(means: WindowMeans, group: IntArray) -> float:
    """Largest difference, at any phase, between the mean of a group and its middle cycle.

    Parabolas a + b n + c n^2 are fitted through the G cycles at each phase, with n counted from
    the middle. The difference is c (G^2 - 1) / 12, as b cancels. For a group of three it is
    exact.
    """
    square = (group - group.mean()) ** 2
    return _largest(means, group, square - square.mean()) * float(square.mean())


def _largest(means: WindowMeans, group: IntArray, pattern: FloatArray) -> float:
    """Largest coefficient of a pattern over a group's cycles, fitted at each phase.

    The coefficients are smoothed over phase by their mean and first harmonic, to remove the
    noise of single windows. The result is zero if it is within four standard errors.
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
