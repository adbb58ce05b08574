"""Reduce a long periodic record: first cycles kept, the later ones averaged at equal phase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray, Nodes
from deabayes.faults import UserError
from deabayes.records.preparation.periods import (
    Cycles,
    WindowMeans,
    check_stated,
    drift,
    found_period,
    off_middle,
    whole_cycles,
    window_means,
)
from deabayes.records.preparation.working import IntArray, Settings, WorkingRecord, intervals

KEYS = ("transition", "points", "window", "group", "stable", "frequency")
STABLE = ("average", "decimate")
GROUPS = 5
OFF_MIDDLE = 0.002
"""Share of the range. Slow noise alone makes half of it, units that still relax twice as much."""


def cycles(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Keep the first cycles of a periodic record and average the later ones in groups.

    Each cycle is divided into `points` bins of equal phase, and the samples in the middle of
    each, `window` of its width, are averaged. The model is averaged over the windows alike.

    Of the first `transition` cycles every bin is a point. Later, stable, cycles go together
    in groups of `group` successive ones: a point is the mean over the group of its cycles'
    means in one bin, each cycle counting alike, and stands at the mean of their times. With an
    odd number of cycles that is the middle cycle at the same phase, where the model is
    evaluated; a drift linear in time cancels. An even number has no middle cycle (its mean time
    is half a period off the phase) and is refused, unless one cycle of each group is kept as
    it is (`stable: decimate`): then nothing is averaged over cycles.

    `samples_averaged` is the number n of raw samples whose mean has the white variance
    sigma_white^2 / n of the point: where G cycles have n_k samples in a bin it is
    G^2 / sum(1 / n_k), all of them together if they are equal, up to 10 % fewer
    where a bin holds now two, now one. As in `average`, the correlated part of the noise is
    not divided: what the model misses at one phase it misses in every cycle. Noise that is
    correlated over longer than a bin but not over a group is in truth averaged too, so its
    amplitude is then that of the points rather than of the record.

    The excitation stays whole. Period and cycles are found from its samples. Cycles are counted
    from the first visible sample of the response, or from where the excitation starts if that
    is later; a rest before it is hidden, and so is an incomplete cycle at the end. Stable
    cycles that fill no group make a smaller last one if they are at least half a group (odd,
    so that one may be left over), and are hidden otherwise. The history says all that.

    A bin without a sample in one of a group's cycles (masked, a gap) is no point.

    Settings
    --------
    transition : cycles kept one by one, default 5; may be 0 where a record begins settled.
    points : bins per cycle, at least 8, default 40.
    window : averaged share of each bin, default 0.5.
    stable : `average` (default) or `decimate`, which keeps the middle cycle of each group.
    group : cycles per group, default so many (odd) that there are about five groups.
    frequency : of the excitation, where it should not be found from the samples. Either way
        it must agree with the row's `frequency_Hz`, if it has one.
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
    found = whole_cycles(record, period, transition, read.where)
    _check_sampling(record, period, points, window, read)
    size = _group_size(found.count - transition, stable, read)
    groups = grouped(min(transition, found.count), found.count, size, stable == "average")
    means = window_means(record, found, points, window)
    kept = [g[g.size // 2][None] for g in groups] if stable == "decimate" else groups
    reduced = _reduced(record, means, kept)
    size_of = float(np.ptp(reduced.response)) or 1.0
    change = max(drift(means, group) for group in groups) / size_of
    off = max(off_middle(means, group) for group in groups) / size_of
    reduced = replace(reduced, remarks=_remarks(record, found, groups, stable, (change, off)))
    if off <= OFF_MIDDLE or stable == "decimate":
        return reduced
    return reduced.with_warning(
        f"means of groups of cycles are up to {off:.2%} of the range off their middle cycles, "
        "where the model is compared: the response still settles after "
        f"{transition} cycles; raise `transition` of the step `cycles`, or average fewer in a "
        "`group`"
    )


def grouped(transition: int, count: int, size: int, odd: bool) -> list[IntArray]:
    """Cycle numbers that make one cycle of points each: first single, then groups of `size`."""
    last = transition + (count - transition) // size * size
    numbers = [np.array([k]) for k in range(transition)]
    numbers += [np.arange(k, k + size) for k in range(transition, last, size)]
    left = count - last
    left -= int(odd and left % 2 == 0 and left > 0)
    return [*numbers, np.arange(last, last + left)] if 2 * left >= size else numbers


def _group_size(stable: int, kind: str, read: Settings) -> int:
    """Cycles per group, as given or about a fifth of the stable ones."""
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
    """Every window must be long enough to hold a sample, wherever samples fall."""
    interval = float(np.median(np.diff(record.coordinate)))
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
    """One point per bin and group, where every cycle of the group has samples."""
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
    """A standard deviation of the times of a window to either side of its middle.

    So a model has the mean of a parabola over the window, whose width is a small part of a period.
    """
    point = np.repeat(np.arange(variance.size), 2)
    offsets = np.sqrt(variance)[point] * np.tile([-1.0, 1.0], variance.size)
    return Nodes(point, offsets, np.full(point.size, 0.5))


def _remarks(
    record: WorkingRecord,
    found: Cycles,
    groups: list[IntArray],
    stable: str,
    changes: tuple[float, float],
) -> dict[str, object]:
    """What the history says: period, cycles used, how they change, what was left out."""
    single = sum(g.size == 1 for g in groups)
    sizes = [int(g.size) for g in groups if g.size > 1]
    used = sum(g.size for g in groups)
    end = found.start + used * found.period
    outside = record.used & ((record.coordinate < found.start) | (record.coordinate >= end))
    words = [f"{found.count} cycles of {found.period:.7g} s from {found.start:.6g} s"]
    words.append(f"{single} one by one")
    if sizes:
        done = "averaged" if stable == "average" else "thinned to the middle one"
        words.append(f"{sum(sizes)} {done} in groups of {', '.join(map(str, sizes))}")
        words.append(f"drift within a group up to {changes[0]:.2%} of the range")
    if sizes and stable == "average":
        words.append(f"means up to {changes[1]:.3%} off the middle cycle")
    if found.count > used:
        words.append(f"{found.count - used} at the end left out")
    return {
        "effect": ", ".join(words),
        "masked": intervals(record.coordinate + record.delay, outside),
        "period_s": found.period,
        "first_cycle_s": found.start,
        "cycles": found.count,
        "group_sizes": [int(g.size) for g in groups],
        "drift": changes[0],
        "off_middle": changes[1],
    }
