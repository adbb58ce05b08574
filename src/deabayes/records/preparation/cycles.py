"""Preparation step: keep the first cycles of a record and average the later ones in phase."""

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
"""Share of the range above which to warn. Slow noise alone reaches half of it; a response that
still relaxes reaches twice as much."""


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
    found: Cycles,
    groups: list[IntArray],
    stable: str,
    changes: tuple[float, float],
) -> dict[str, object]:
    """Entries for the history: period, cycles used, changes over cycles, cycles left out."""
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
