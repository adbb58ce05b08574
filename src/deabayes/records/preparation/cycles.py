"""Preparation step: keep the first cycles of a record and average the later ones in phase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deabayes.experiment import FloatArray, Nodes
from deabayes.faults import UserError
from deabayes.integrate.periodic import HYSTERESIS, alike, passes, steady, usual_period
from deabayes.records.preparation.working import IntArray, Settings, WorkingRecord, intervals

KEYS = ("transition", "points", "window", "group", "stable", "frequency")
STABLE = ("average", "decimate")
GROUPS = 5
OFF_MIDDLE = 0.002
"""Share of the range above which to warn. Slow noise alone reaches half of it; a response that
still relaxes reaches twice as much."""
FEWEST_CYCLES = 3
STATED_WITHIN = 0.01
LEAD = 0.05
PHASES = 200
UNLIKE = 0.02
INSTEAD = "use `average` for a sweep, a step or a few cycles"
ROUNDING = 1e-6
SEEN = 4.0
"""Number of standard errors above which a change over cycles is significant."""


def cycles(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Keep the first cycles of a periodic record and average the later ones in groups.

    Each cycle is divided into `points` bins of equal phase. The samples in the middle of each
    bin, over the share `window` of its width, are averaged. The model is averaged over the same
    windows.

    In the first `transition` cycles every bin gives a point. The later, stable cycles are
    grouped, `group` successive cycles at a time. A point of a group is the mean over its cycles'
    means in one bin, with equal weights, at the mean of their times. With an odd number of
    cycles this is the time of the middle cycle at the same phase, where the model is evaluated;
    a drift linear in time cancels. An even number has no middle cycle, because its mean time is
    half a period off the phase. Even groups are therefore refused, unless one cycle of each
    group is kept unchanged (`stable: decimate`), without averaging over cycles.

    `samples_averaged` is the number n of raw samples whose mean has the white variance
    sigma_white^2 / n of the point. If G cycles have n_k samples in a bin, n is
    G^2 / sum(1 / n_k). For equal n_k this is the number of all samples together; where n_k
    alternates between one and two, it is up to 10 % smaller. As in `average`, the correlated
    part of the noise is not divided: an error of the model at one phase recurs in every cycle.
    Noise that is correlated over longer than a bin but not over a group is in fact averaged too.
    Its amplitude is then that of the points rather than of the record.

    The excitation is not shortened; period and cycles are found from its samples. Cycles are
    counted from the first visible sample of the response, or from the start of the excitation if
    that is later. The rest before it and an incomplete cycle at the end are hidden. Stable
    cycles that do not fill a group form a smaller last group if they are at least half a group;
    one may be left over to make their number odd. Otherwise they are hidden. The history records
    all of this.

    A bin that has no sample (masked, or a gap) in one of a group's cycles gives no point.

    Settings
    --------
    transition : cycles kept one by one, default 5; may be 0 if the record begins settled.
    points : bins per cycle, at least 8, default 40.
    window : averaged share of each bin, default 0.5.
    stable : `average` (default) or `decimate`, which keeps the middle cycle of each group.
    group : cycles per group; the default is odd and gives about five groups.
    frequency : frequency of the excitation; default found from the samples. It must agree with
        the row's `frequency_Hz`, if given.
    """
    read = Settings("cycles", settings, record, KEYS)
    transition = read.count("transition", 5, lowest=0)
    points, window = read.count("points", 40, lowest=8), read.number("window", 0.5, 0.01, 1.0)
    stable = read.choice("stable", STABLE, "average")
    if read.has("frequency"):
        period = 1.0 / read.positive("frequency", "Hz")
    else:
        period = found_period(record, read.where)
    check_stated(period, record, read.where)
    complete = whole_cycles(record, period, transition, read.where)
    _check_sampling(record, period, points, window, read)
    size = _group_size(complete.count - transition, stable, read)
    groups = grouped(min(transition, complete.count), complete.count, size, stable == "average")
    means = window_means(record, complete, points, window)
    kept = [g[g.size // 2][None] for g in groups] if stable == "decimate" else groups
    reduced = _reduced(record, means, kept)
    size_of = float(np.ptp(reduced.response)) or 1.0
    change = max(drift(means, group) for group in groups) / size_of
    off = max(off_middle(means, group) for group in groups) / size_of
    reduced = replace(reduced, remarks=_remarks(record, complete, groups, stable, (change, off)))
    if off > OFF_MIDDLE and stable == "average":
        record.report.warn(
            f"means of groups of cycles are up to {off:.2%} of the range off their middle cycles, "
            "where the model is compared: the response still settles after "
            f"{transition} cycles; raise `transition` of the step `cycles`, or average fewer in a "
            "`group`"
        )
    return reduced


def grouped(transition: int, count: int, size: int, odd: bool) -> list[IntArray]:
    """Return the cycle numbers of each cycle of points: single ones, then groups of `size`."""
    last = transition + (count - transition) // size * size
    numbers = [np.array([k]) for k in range(transition)]
    numbers += [np.arange(k, k + size) for k in range(transition, last, size)]
    left = count - last
    left -= int(odd and left % 2 == 0 and left > 0)
    return [*numbers, np.arange(last, last + left)] if 2 * left >= size else numbers


def _group_size(stable: int, kind: str, read: Settings) -> int:
    """Return the cycles per group, by default about a fifth of the stable cycles."""
    if not read.has("group"):
        size = max(stable // GROUPS, 1)
        return size - (size + 1) % 2 if size > 1 else 1
    size = read.count("group")
    if kind == "average" and size % 2 == 0:
        raise UserError(
            f"{read.where}.group: the mean time of {size} cycles is half a period off their phase; "
            f"give an odd number, such as {size + 1}"
        )
    if size > stable > 0:
        raise UserError(
            f"{read.where}.group: {size} cycles, but only {stable} follow the transition; "
            "give fewer, or leave it out"
        )
    return size


def _check_sampling(
    record: WorkingRecord, period: float, points: int, window: float, read: Settings
) -> None:
    """Check that every window is long enough to hold at least one sample."""
    interval = record.interval
    most = int(period * window / interval * (1.0 + 1e-6))
    if points <= most:
        return
    raise UserError(
        f"{read.where}: a cycle has {period / interval:.4g} samples, too few for {points} points "
        f"that each average {window:g} of a bin; give `points: {most}` or fewer, at least 8, a "
        "larger `window`, or leave the step out"
    )


def _reduced(
    record: WorkingRecord, means: WindowMeans, groups: Sequence[IntArray]
) -> WorkingRecord:
    """Make one point per bin and group if every cycle of the group has samples there."""
    samples = np.concatenate(
        [g.size**2 / np.sum(1.0 / means.samples[g], axis=0) for g in groups],
    )
    whole = np.isfinite(samples)
    response = np.concatenate([means.response[g].mean(axis=0) for g in groups])
    coordinate = np.concatenate([means.coordinate[g].mean(axis=0) for g in groups])
    return replace(
        record,
        coordinate=coordinate[whole],
        response=response[whole],
        used=np.ones(int(whole.sum()), dtype=bool),
        samples_averaged=samples[whole],
        nodes=_nodes(np.concatenate([means.variance[g].mean(axis=0) for g in groups])[whole]),
    )


def _nodes(variance: FloatArray) -> Nodes:
    """Place two nodes one standard deviation of a window's times to either side of its middle.

    The model is thereby averaged as a parabola over the window, which is a small part of a
    period.
    """
    point = np.repeat(np.arange(variance.size), 2)
    offsets = np.sqrt(variance)[point] * np.tile([-1.0, 1.0], variance.size)
    return Nodes(point, offsets, np.full(point.size, 0.5))


def _remarks(
    record: WorkingRecord,
    complete: Cycles,
    groups: list[IntArray],
    stable: str,
    changes: tuple[float, float],
) -> dict[str, object]:
    """Entries for the history: period, cycles used, changes over cycles, cycles left out."""
    single = sum(g.size == 1 for g in groups)
    sizes = [int(g.size) for g in groups if g.size > 1]
    used = sum(g.size for g in groups)
    end = complete.start + used * complete.period
    outside = record.used & ((record.coordinate < complete.start) | (record.coordinate >= end))
    words = [f"{complete.count} cycles of {complete.period:.7g} s from {complete.start:.6g} s"]
    words.append(f"{single} one by one")
    if sizes:
        done = "averaged" if stable == "average" else "thinned to the middle one"
        words.append(f"{sum(sizes)} {done} in groups of {', '.join(map(str, sizes))}")
        words.append(f"drift within a group up to {changes[0]:.2%} of the range")
    if sizes and stable == "average":
        words.append(f"means up to {changes[1]:.3%} off the middle cycle")
    if complete.count > used:
        words.append(f"{complete.count - used} at the end left out")
    return {
        "effect": ", ".join(words),
        "masked": intervals(record.coordinate + record.delay, outside),
        "period_s": complete.period,
        "first_cycle_s": complete.start,
        "cycles": complete.count,
        "group_sizes": [int(g.size) for g in groups],
        "drift": changes[0],
        "off_middle": changes[1],
    }


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
    half = 0.5 * record.interval
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


def window_means(
    record: WorkingRecord, complete: Cycles, points: int, window: float
) -> WindowMeans:
    """Average the visible samples in the middle `window` of each of `points` bins per cycle."""
    visible = np.flatnonzero(record.used)
    place = (record.coordinate[visible] - complete.start) / complete.period * points
    bins = np.floor(place).astype(np.intp)
    # Half-open windows, shifted slightly: rounding then cannot decide about a sample on an edge.
    offset = place - bins - 0.5 + ROUNDING
    near = (offset >= -0.5 * window) & (offset < 0.5 * window)
    near &= (bins >= 0) & (bins < complete.count * points)
    visible, bins = visible[near], bins[near]
    weights = record.samples_averaged[visible]

    def total(values: FloatArray) -> FloatArray:
        sums = np.bincount(bins, weights * values, minlength=complete.count * points)
        return np.asarray(sums.reshape(complete.count, points), dtype=np.float64)

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
