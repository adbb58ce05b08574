"""Bins that a record is averaged in, and where a model is evaluated for the same average."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Nodes
from deabayes.faults import UserError
from deabayes.records.preparation.polyline import corners, polyline
from deabayes.records.preparation.working import IntArray, WorkingRecord

CORNER_FRACTION = 0.05
NOISE_FRACTION = 0.01
JUMP_FRACTION = 0.1
JUMP_RATIO = 20.0
ALONG_PATH = 5.0
LONGEST_GRID = 100_000
NEXT_SAMPLES = 9
"""Of which the sampling interval behind a corner is taken."""


def geometric_edges(
    record: WorkingRecord,
    first_width: float | None,
    ratio: float,
    widest: float,
    largest_change: float,
) -> FloatArray:
    """Ascending edges; bins start anew at every corner of the excitation.

    Parameters
    ----------
    first_width, widest : on the record's coordinate; None takes four sampling intervals.
    ratio : of neighbouring widths away from a corner.
    largest_change : how much of its range the excitation may travel within a bin.
    """
    last = float(record.coordinate[-1])
    interval = float(np.median(np.diff(record.coordinate)))
    turns = record_corners(record)
    starts = [float(min(record.coordinate[0], record.excitation_start())), *map(float, turns)]
    starts = sorted({start for start in starts if start < last})
    path = travel(record)
    edges: list[float] = []
    for start, end in zip(starts, [*starts[1:], np.nextafter(last, np.inf)], strict=True):
        edge = start
        first = (
            4.0 * _interval_behind(record, start, interval) if first_width is None else first_width
        )
        while edge < end and len(edges) < LONGEST_GRID:
            edges.append(edge)
            width = min(widest, first + (ratio - 1.0) * (edge - start))
            edge = min(edge + width, _after_travel(*path, edge, largest_change))
    if len(edges) == LONGEST_GRID:
        raise _too_many_bins(record, "first_width, widest or largest_change")
    return np.array([*edges, np.nextafter(last, np.inf)])


def record_corners(record: WorkingRecord) -> FloatArray:
    """Where the excitation turns."""
    interval = float(np.median(np.diff(record.coordinate)))
    tolerance = CORNER_FRACTION * record.excitation_range
    return corners(record.excitation_coordinate, record.excitation, tolerance, interval)


def _interval_behind(record: WorkingRecord, start: float, usual: float) -> float:
    """The sampling interval behind a corner, where it is clearly shorter than the usual one."""
    behind = record.coordinate[np.searchsorted(record.coordinate, start) :][:NEXT_SAMPLES]
    interval = float(np.median(np.diff(behind))) if behind.size > 1 else usual
    return interval if interval < 0.5 * usual else usual


def _too_many_bins(record: WorkingRecord, keys: str, found: str = "") -> UserError:
    return UserError(
        f"preparation of {record.row.name} ({record.row.protocol}), average: makes more than "
        f"{LONGEST_GRID} bins{found}; give a larger average.{keys}"
    )


def travel(record: WorkingRecord) -> tuple[FloatArray, FloatArray]:
    """Knots, and the path the excitation has gone up to each, in units of its range.

    Counted on a polyline within 1 % of the range, so that noise on a monitored
    voltage does not add up to a path.
    """
    size = record.excitation_range
    knots = polyline(record.excitation_coordinate, record.excitation, NOISE_FRACTION * size)
    steps = np.abs(np.diff(record.excitation[knots])) / (size or 1.0)
    return record.excitation_coordinate[knots], np.concatenate([[0.0], np.cumsum(steps)])


def _after_travel(knots: FloatArray, travelled: FloatArray, edge: float, change: float) -> float:
    """Where the excitation has gone `change` further than at `edge`; infinite if never."""
    target = float(np.interp(edge, knots, travelled)) + change
    if target >= travelled[-1]:
        return np.inf
    upper = int(np.searchsorted(travelled, target, side="left"))
    share = (target - travelled[upper - 1]) / (travelled[upper] - travelled[upper - 1])
    reached = float(knots[upper - 1] + share * (knots[upper] - knots[upper - 1]))
    return max(reached, float(np.nextafter(edge, np.inf)))


def uniform_edges(record: WorkingRecord, first: float, last: float, width: float) -> FloatArray:
    """Edges `width` apart within [first, last], and one at every jump of the excitation."""
    bins = max(int(np.ceil((last - first) / width * (1.0 - 1e-12))), 1)
    if bins > LONGEST_GRID:
        raise _too_many_bins(record, "width, or fewer points", f" ({bins})")
    edges = first + width * np.arange(bins)
    edges = np.append(edges, np.nextafter(max(last, float(edges[-1])), np.inf))
    inside = [jump for jump in jumps(record) if first < jump < last]
    return np.union1d(edges, inside)


def jumps(record: WorkingRecord) -> FloatArray:
    """Coordinates right after a jump, by 10 % of the excitation's range.

    It is 20 times as fast as the range over the record's length, and five times as fast as the
    excitation is on average along its path: a sine of more than six cycles has the first pace on
    its own, of which its straight pieces or few samples are no jumps.
    """
    size = record.excitation_range
    change = np.abs(np.diff(record.excitation))
    knots, path = travel(record)
    usual = size * max(JUMP_RATIO, ALONG_PATH * float(path[-1])) / (knots[-1] - knots[0])
    fast = change > usual * np.diff(record.excitation_coordinate)
    return record.excitation_coordinate[1:][fast & (change > JUMP_FRACTION * size)]


WHERE_IT_BENDS, USUAL = 8, 2
"""Most nodes of a bin: right behind a corner of the excitation and while a response rings, and
elsewhere. What fades within t changes by e^(-w/t) over a bin of width w: two nodes are right to
(w/t)^4 / 4320. Eight are right for a ringing of which a bin holds a period."""


def nodes_of(
    place: FloatArray, weights: FloatArray, starts: IntArray, bends: NDArray[np.bool_]
) -> Nodes:
    """All samples of bins with few, the Gauss rule of the samples of others; see `WHERE_IT_BENDS`.

    Parameters
    ----------
    place : (M,) of the samples, from their bin's mean on.
    weights : (M,) of the samples.
    starts : (N,) first sample of each bin.
    bends : (N,) bins in which the response may bend much.
    """
    ends = np.append(starts[1:], place.size)
    offsets, shares = [], []
    for first, end, close in zip(starts, ends, bends, strict=True):
        x, w = place[first:end], weights[first:end] / weights[first:end].sum()
        most = WHERE_IT_BENDS if close else USUAL
        if x.size > most:
            x, w = gauss(x, w, most)
        offsets.append(x)
        shares.append(w)
    counts = [each.size for each in offsets]
    point = np.repeat(np.arange(starts.size), counts)
    return Nodes(point, np.concatenate(offsets), np.concatenate(shares))


def gauss(x: FloatArray, weights: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and shares with the mean of every polynomial of degree 2 count - 1.

    Golub & Welsch (1969, Math. Comp. 23, 221): orthogonal polynomials of the samples follow from
    p_0 = 1 by p_(k+1) = (x - a_k) p_k - b_k p_(k-1), a_k = <x p_k^2> / <p_k^2>,
    b_k = <p_k^2> / <p_(k-1)^2>. The nodes are the eigenvalues of the matrix with diagonal a and
    off-diagonal sqrt(b), the shares the squares of the eigenvectors' first components.

    Parameters
    ----------
    x, weights : (M,) samples, more than `count` different ones, and weights whose sum is 1.
    """
    width = float(np.abs(x).max())
    x = x / width
    matrix = np.zeros((count, count))
    before, now, norm = np.zeros_like(x), np.ones_like(x), 1.0
    for k in range(count):
        last, norm = norm, float(weights @ now**2)
        a, b = float(weights @ (x * now**2)) / norm, norm / last if k else 0.0
        matrix[k, k] = a
        if k:
            matrix[k, k - 1] = matrix[k - 1, k] = np.sqrt(b)
        before, now = now, (x - a) * now - b * before
    nodes, vectors = np.linalg.eigh(matrix)
    return width * nodes, vectors[0] ** 2


NOTED = 0.005
"""Of an amplitude: what a bin may take off it without a word."""


def width_for(share: float, frequency: float) -> float:
    """Of a bin [s] that takes a small share off a sine's amplitude [Hz].

    A mean over w leaves sin(x) / x of it, x = pi w f: it takes x^2 / 6 off.
    """
    return float(np.sqrt(6.0 * share) / (np.pi * frequency))


def harmonics(record: WorkingRecord) -> int:
    """Highest multiple of the excitation's frequency that a response has much of.

    Motions follow the square of a voltage: all of that of a sine through zero is at twice its
    frequency, and a part of that of any other.
    """
    return 2 if record.row.excitation == "voltage" else 1
