"""The usual steps for a sine: few points, and none of the response's amplitude lost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.faults import UserError
from deabayes.passes import passes
from deabayes.preparation.flattening import NOTED, harmonics, width_for
from deabayes.preparation.grid import LONGEST_GRID
from deabayes.preparation.periods import found_period, whole_cycles
from deabayes.preparation.working import WorkingRecord

POINTS = 400
TRANSITION, PER_CYCLE, FEWEST_PER_CYCLE = 5, 40, 20
"""Of the step `cycles`: its defaults, and the fewest bins per cycle that flatten little."""
MANY_SAMPLES, FINE = 20_000, 1e-4
"""Of an excitation, above which it is described by knots; and how far these may be off, of its
range. Lines lie inside a sine, so that its amplitude comes out too small by as much."""


def sine_steps(record: WorkingRecord) -> list[Step]:
    """Uniform bins for a few cycles, the step `cycles` for many, else narrow bins thinned.

    Bins are at most so wide that they take 0.1 % off the highest harmonic that the response has
    much of (a period's eightieth for a voltage). 400 of them hold five cycles. The step `cycles`
    needs cycles that are alike and 40 samples in each; a record without keeps bins of that width,
    or its samples, every n-th of them, so that about 400 points remain.
    """
    many = record.excitation.size > MANY_SAMPLES
    knots: list[Step] = [{"excitation_knots": {"fraction": FINE}}] if many else []
    visible = record.coordinate[record.used]
    span, interval = float(np.ptp(visible)), float(np.median(np.diff(visible)))
    times = passes(record.excitation_coordinate, record.excitation)
    period = float(np.diff(times).min()) if times.size > 1 else span
    width = width_for(0.2 * NOTED, harmonics(record) / period)
    if span <= POINTS * width:
        return [*knots, {"average": {"grid": "uniform", "points": POINTS}}]
    per_cycle = _bins_per_cycle(record, interval)
    if per_cycle >= FEWEST_PER_CYCLE:
        points = {} if per_cycle == PER_CYCLE else {"points": per_cycle}
        return [{"cycles": points}, *knots]
    return [*knots, *_thinned(span, interval, period, width)]


def _bins_per_cycle(record: WorkingRecord, interval: float) -> int:
    """How many the step `cycles` can make of each cycle, half a bin averaged; 0 if it refuses."""
    try:
        period = found_period(record, "")
        whole_cycles(record, period, TRANSITION, "")
    except UserError:
        return 0
    return min(PER_CYCLE, int(0.5 * period / interval * (1.0 + 1e-6)))


def _thinned(span: float, interval: float, period: float, width: float) -> list[Step]:
    steps: list[Step] = []
    if interval < width and span < LONGEST_GRID * width:
        steps.append({"average": {"grid": "uniform", "width": f"{width:.6g} s"}})
    else:
        width = interval
    least = span / width / POINTS
    if least > 1.0:
        steps.append({"decimate": {"every": _every(least, width / period)}})
    return steps


def _every(least: float, share: float) -> int:
    """Of bins that are `share` of a period: about `least`, so that phases do not recur soon.

    No phase comes back within four points where another choice avoids it, nor within two.
    """
    candidates = np.arange(max(int(0.75 * least), 1), int(np.ceil(least)) + 1)
    turns = candidates[:, None] * share * np.arange(1, 5)
    away = np.abs(turns - np.round(turns))
    return int(candidates[np.argmax(away.min(axis=1) + 0.01 * away[:, :2].min(axis=1))])
