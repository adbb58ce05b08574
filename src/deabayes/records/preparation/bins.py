"""Bins for averaging a record, and the points where a model is evaluated for the same average."""

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
"""Number of samples after a corner from which the sampling interval is taken."""


def geometric_edges(
    record: WorkingRecord,
    first_width: float | None,
    ratio: float,
    widest: float,
    largest_change: float,
) -> FloatArray:
    """Return ascending edges of bins that start anew at every corner of the excitation.

    Parameters
    ----------
    first_width, widest : widths on the record's coordinate; `first_width` None means four
        sampling intervals.
    ratio : ratio of neighbouring widths away from a corner.
    largest_change : largest path of the excitation within a bin, as a share of its range.
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
    """Return the coordinates at which the excitation turns."""
    interval = float(np.median(np.diff(record.coordinate)))
    tolerance = CORNER_FRACTION * record.excitation_range
    return corners(record.excitation_coordinate, record.excitation, tolerance, interval)


def _interval_behind(record: WorkingRecord, start: float, usual: float) -> float:
    """Sampling interval after a corner if less than half the usual one, else the usual one."""
    behind = record.coordinate[np.searchsorted(record.coordinate, start) :][:NEXT_SAMPLES]
    interval = float(np.median(np.diff(behind))) if behind.size > 1 else usual
    return interval if interval < 0.5 * usual else usual


def _too_many_bins(record: WorkingRecord, keys: str, found: str = "") -> UserError:
    return UserError(
        f"preparation of {record.row.name} ({record.row.protocol}), average: makes more than "
        f"{LONGEST_GRID} bins{found}; give a larger average.{keys}"
    )


def travel(record: WorkingRecord) -> tuple[FloatArray, FloatArray]:
    """Return knots, and the path of the excitation up to each knot in units of its range.

    The path is counted on a polyline within 1 % of the range, so that noise on a monitored
    voltage does not add up.
    """
    size = record.excitation_range
    knots = polyline(record.excitation_coordinate, record.excitation, NOISE_FRACTION * size)
    steps = np.abs(np.diff(record.excitation[knots])) / (size or 1.0)
    return record.excitation_coordinate[knots], np.concatenate([[0.0], np.cumsum(steps)])


def _after_travel(knots: FloatArray, travelled: FloatArray, edge: float, change: float) -> float:
    """Where the excitation has travelled `change` further than at `edge`; infinite if never."""
    target = float(np.interp(edge, knots, travelled)) + change
    if target >= travelled[-1]:
        return np.inf
    upper = int(np.searchsorted(travelled, target, side="left"))
    share = (target - travelled[upper - 1]) / (travelled[upper] - travelled[upper - 1])
    reached = float(knots[upper - 1] + share * (knots[upper] - knots[upper - 1]))
    return max(reached, float(np.nextafter(edge, np.inf)))


def uniform_edges(record: WorkingRecord, first: float, last: float, width: float) -> FloatArray:
    """Return edges `width` apart within [first, last], plus one at every jump of the excitation."""
    bins = max(int(np.ceil((last - first) / width * (1.0 - 1e-12))), 1)
    if bins > LONGEST_GRID:
        raise _too_many_bins(record, "width, or fewer points", f" ({bins})")
    edges = first + width * np.arange(bins)
    edges = np.append(edges, np.nextafter(max(last, float(edges[-1])), np.inf))
    inside = [jump for jump in jumps(record) if first < jump < last]
    return np.union1d(edges, inside)


def jumps(record: WorkingRecord) -> FloatArray:
    """Return the coordinates just after jumps of more than 10 % of the excitation's range.

    A jump is also 20 times as fast as the range over the record's length, and five times as fast
    as the excitation's average along its path. The second limit is for sines: with more than six
    cycles a sine reaches the first speed without any jump.
    """
    size = record.excitation_range
    change = np.abs(np.diff(record.excitation))
    knots, path = travel(record)
    usual = size * max(JUMP_RATIO, ALONG_PATH * float(path[-1])) / (knots[-1] - knots[0])
    fast = change > usual * np.diff(record.excitation_coordinate)
    return record.excitation_coordinate[1:][fast & (change > JUMP_FRACTION * size)]


WHERE_IT_BENDS, USUAL = 8, 2
"""Most nodes of a bin, first after a corner of the excitation and during ringing, then
elsewhere. A response that decays with time constant t changes by e^(-w/t) over a bin of width
w: the relative error of two nodes is (w/t)^4 / 4320. Eight nodes suffice if a bin holds one
period of a ringing."""


def nodes_of(
    place: FloatArray, weights: FloatArray, starts: IntArray, bends: NDArray[np.bool_]
) -> Nodes:
    """Use all samples of bins with few samples, and Gauss nodes for the others.

    The number of nodes is limited by `WHERE_IT_BENDS`.

    Parameters
    ----------
    place : (M,) position of each sample relative to the mean of its bin.
    weights : (M,) weights of the samples.
    starts : (N,) first sample of each bin.
    bends : (N,) whether the response may bend strongly within the bin.
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
    """Return nodes and weights that average every polynomial of degree 2 count - 1 exactly.

    Golub & Welsch (1969, Math. Comp. 23, 221): orthogonal polynomials of the samples follow from
    p_0 = 1 by p_(k+1) = (x - a_k) p_k - b_k p_(k-1), a_k = <x p_k^2> / <p_k^2>,
    b_k = <p_k^2> / <p_(k-1)^2>. The nodes are the eigenvalues of the matrix with diagonal a and
    off-diagonal sqrt(b). The weights are the squares of the eigenvectors' first components.

    Parameters
    ----------
    x, weights : (M,) samples, more than `count` of them distinct, and weights that sum to 1.
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
"""Share by which a bin may reduce an amplitude without a warning."""


def width_for(share: float, frequency: float) -> float:
    """Return the width [s] of a bin that reduces a sine's amplitude by a small share.

    A mean over the width w of a sine of frequency f [Hz] multiplies its amplitude by sin(x) / x
    with x = pi w f, a reduction by x^2 / 6.
    """
    return float(np.sqrt(6.0 * share) / (np.pi * frequency))


def harmonics(record: WorkingRecord) -> int:
    """Highest multiple of the excitation's frequency that is strong in a response.

    The motion follows the square of the voltage. A sine through zero drives the motion at twice
    its frequency only; with a bias, part of the motion is at twice the frequency.
    """
    return 2 if record.row.excitation == "voltage" else 1
