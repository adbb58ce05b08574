"""Average a dense record onto the likelihood's grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray, Nodes
from deabayes.records.excitation import STEPS
from deabayes.records.preparation.bins import (
    geometric_edges,
    nodes_of,
    record_corners,
    uniform_edges,
)
from deabayes.records.preparation.ringing import ringing
from deabayes.records.preparation.working import BoolArray, IntArray, Settings, WorkingRecord

FIRST_BINS = 8
"""Behind a corner of the excitation, in which a response may bend much."""
FADED, WIDE = 3.0, 0.1
"""Times the while in which a ringing is seen: then nothing is left of it; and the share of its
period above which a bin is wide: of narrower ones two nodes are right to 4e-5 of its height."""
GRIDS = ("geometric", "uniform")
KEYS: Mapping[str, tuple[str, ...]] = {
    "geometric": ("grid", "first_width", "ratio", "widest", "largest_change"),
    "uniform": ("grid", "points", "width"),
}


def average(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Replace the visible samples of each bin by their mean.

    A point of n samples stands at their mean coordinate, has their mean
    response and `samples_averaged` n: its white noise has the variance
    sigma_white^2 / n, and the likelihood is told so. What is compared with it is the mean of the
    model over the same samples (`nodes_of`), so that a response which bends or swings within a
    bin is no worse for it. The correlated part of the noise is not divided: the discrepancy
    hardly changes within a bin that is narrow against its correlation time, and its value at the
    mean coordinate stands for the bin.

    No bin reaches across a masked stretch or a jump of the excitation.
    A record with no more samples than the grid has bins is left as it is.

    Settings
    --------
    grid : `geometric` (default) or `uniform`.
    geometric: bins restart at every corner of the excitation and widen with the
    time t since: width = first_width + (ratio - 1) t, at most `widest`, and at
    most as long as the excitation takes to travel `largest_change` of its range.
        first_width : default four sampling intervals, of the samples behind the corner where
            they are at least twice as dense as is usual in the record;
        ratio : of neighbouring widths, default 1.1;
        widest : default a fiftieth of the record;
        largest_change : a fraction, default 0.04.
    uniform:
        points : number of bins over the record, default 200; or
        width : of a bin.
    """
    grid = Settings("average", {"grid": settings.get("grid", "geometric")}, record, ("grid",))
    kind = grid.choice("grid", GRIDS)
    read = Settings("average", settings, record, KEYS[kind])
    edges = _geometric(record, read) if kind == "geometric" else _uniform(record, read)
    if int(record.used.sum()) <= edges.size - 1 and kind == "uniform":
        return record
    return _means(record, edges)


def _geometric(record: WorkingRecord, read: Settings) -> FloatArray:
    """Edges of the geometric grid, defaults taken from the record."""
    unit = record.coordinate_unit
    span = float(np.ptp(record.coordinate))
    return geometric_edges(
        record,
        first_width=read.positive("first_width", unit) if read.has("first_width") else None,
        ratio=read.number("ratio", 1.1, 1.0, 10.0),
        widest=read.positive("widest", unit, span / 50.0),
        largest_change=read.number("largest_change", 0.04, 1e-6, 1.0),
    )


def _uniform(record: WorkingRecord, read: Settings) -> FloatArray:
    """Edges of the uniform grid over the visible part of the record."""
    read.at_most_one("points", "width")
    visible = record.coordinate[record.used]
    first, last = float(visible[0]), float(visible[-1])
    if read.has("width"):
        width = read.positive("width", record.coordinate_unit)
    else:
        width = (last - first) / read.count("points", 200)
    return uniform_edges(record, first, last, width)


def _means(record: WorkingRecord, edges: FloatArray) -> WorkingRecord:
    """Bin means over runs of visible samples that share a bin."""
    visible = np.flatnonzero(record.used)
    bins = np.searchsorted(edges, record.coordinate[visible], side="right")
    starts = _run_starts(bins, visible)
    weights = record.samples_averaged[visible]
    total = np.add.reduceat(weights, starts)

    def mean(values: FloatArray) -> FloatArray:
        return np.add.reduceat(weights * values[visible], starts) / total

    coordinate = mean(record.coordinate)
    away = record.coordinate[visible] - np.repeat(coordinate, np.diff([*starts, visible.size]))
    return replace(
        record,
        coordinate=coordinate,
        response=mean(record.response),
        used=np.ones(starts.size, dtype=bool),
        samples_averaged=total,
        nodes=_nodes(record, visible, away, weights, starts),
    )


def _nodes(
    record: WorkingRecord,
    visible: IntArray,
    away: FloatArray,
    weights: FloatArray,
    starts: IntArray,
) -> Nodes:
    """Where a model has the mean over the bins; of samples that are means, over theirs."""
    bends = _bends(record, record.coordinate[visible[starts]])
    if record.nodes is not None:
        inner = record.nodes.at(visible)
        away = away[inner.point] + inner.offsets
        weights = weights[inner.point] * inner.shares
        starts = inner.starts[starts]
    return nodes_of(away, weights, starts, bends)


def _bends(record: WorkingRecord, begins: FloatArray) -> BoolArray:
    """Bins, by where they begin (N,), that are right behind a corner or in which it rings."""
    turns = record_corners(record)
    bends = np.zeros(begins.size, dtype=bool)
    for first in np.maximum(np.searchsorted(begins, turns, side="right") - 1, 0):
        bends[first : first + FIRST_BINS] = True
    rings = ringing(record) if record.row.protocol in STEPS else None
    if rings is not None:
        wide = np.diff(begins, append=record.coordinate[-1]) > WIDE * rings.period
        bends |= wide & (begins < rings.start + FADED * (rings.end - rings.start))
    return bends


def _run_starts(bins: IntArray, visible: IntArray) -> IntArray:
    """Where a new bin, or a new stretch after masked samples, begins."""
    new = (np.diff(bins) != 0) | (np.diff(visible) != 1)
    return np.concatenate([[0], np.flatnonzero(new) + 1])
