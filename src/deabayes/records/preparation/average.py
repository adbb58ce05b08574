"""Preparation step: average a dense record onto the likelihood's grid."""

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
"""Number of bins after a corner of the excitation in which a response may bend strongly."""
FADED, WIDE = 3.0, 0.1
"""After three times the time in which a ringing is visible, nothing is left of it. A bin is wide
above 0.1 of the ringing's period; in narrower bins two nodes are right to 4e-5 of its height."""
GRIDS = ("geometric", "uniform")
KEYS: Mapping[str, tuple[str, ...]] = {
    "geometric": ("grid", "first_width", "ratio", "widest", "largest_change"),
    "uniform": ("grid", "points", "width"),
}


def average(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Replace the visible samples of each bin by their mean.

    A point of n samples lies at their mean coordinate and has their mean response. Its
    `samples_averaged` is n: the likelihood divides the variance sigma_white^2 of white noise by
    n. The point is compared with the mean of the model over the same samples (`nodes_of`), so a
    response that bends or swings within a bin causes no error. The correlated part of the noise
    is not divided: the discrepancy hardly changes within a bin that is narrow compared with its
    correlation time. Its value at the mean coordinate represents the bin.

    No bin extends across a masked stretch or a jump of the excitation. The uniform grid leaves a
    record unchanged that has no more samples than the grid has bins.

    Settings
    --------
    grid : `geometric` (default) or `uniform`.
    geometric: bins restart at every corner of the excitation and widen with the
    time t since the corner: width = first_width + (ratio - 1) t, at most `widest`. A bin also
    ends when the excitation has travelled `largest_change` of its range.
        first_width : default four sampling intervals. The interval after the corner is used if
            samples there are at least twice as dense as usual in the record;
        ratio : ratio of neighbouring widths, default 1.1;
        widest : default a fiftieth of the record;
        largest_change : a fraction, default 0.04.
    uniform:
        points : number of bins over the record, default 200; or
        width : width of a bin.
    """
    grid = Settings("average", {"grid": settings.get("grid", "geometric")}, record, ("grid",))
    kind = grid.choice("grid", GRIDS)
    read = Settings("average", settings, record, KEYS[kind])
    edges = _geometric(record, read) if kind == "geometric" else _uniform(record, read)
    if int(record.used.sum()) <= edges.size - 1 and kind == "uniform":
        return record
    return _means(record, edges)


def _geometric(record: WorkingRecord, read: Settings) -> FloatArray:
    """Edges of the geometric grid, with defaults taken from the record."""
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
    """Return means over runs of successive visible samples in the same bin."""
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
    """Nodes that average a model over the bins; nodes of earlier means are merged."""
    bends = _bends(record, record.coordinate[visible[starts]])
    if record.nodes is not None:
        inner = record.nodes.at(visible)
        away = away[inner.point] + inner.offsets
        weights = weights[inner.point] * inner.shares
        starts = inner.starts[starts]
    return nodes_of(away, weights, starts, bends)


def _bends(record: WorkingRecord, begins: FloatArray) -> BoolArray:
    """Mark bins that begin at (N,) just after a corner, or wide bins during ringing."""
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
    """Return the indices where a new bin, or a new stretch after masked samples, begins."""
    new = (np.diff(bins) != 0) | (np.diff(visible) != 1)
    return np.concatenate([[0], np.flatnonzero(new) + 1])
