"""Preparation step: average a dense record onto the likelihood's grid, and detect ringing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from deabayes.experiment import FloatArray, Nodes
from deabayes.faults import UserError
from deabayes.records.channels import STEPS, least_swing, usual_interval, without_single_samples
from deabayes.records.preparation.excitation import corners, polyline
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
CORNER_FRACTION = 0.05
NOISE_FRACTION = 0.01
JUMP_FRACTION = 0.1
JUMP_RATIO = 20.0
ALONG_PATH = 5.0
LONGEST_GRID = 100_000
NEXT_SAMPLES = 9
"""Number of samples after a corner from which the sampling interval is taken."""
WHERE_IT_BENDS, USUAL = 8, 2
"""Most nodes of a bin, first after a corner of the excitation and during ringing, then
elsewhere. A response that decays with time constant t changes by e^(-w/t) over a bin of width
w: the relative error of two nodes is (w/t)^4 / 4320. Eight nodes suffice if a bin holds one
period of a ringing."""
NOTED = 0.005
"""Share by which a bin may reduce an amplitude without a warning."""
FEWEST_TURNS = 2
DECAYED = 0.5
EARLY = 0.75
FIRST_TURNS = 6


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
    turns = record_corners(record)
    starts = [float(min(record.coordinate[0], record.excitation_start())), *map(float, turns)]
    starts = sorted({start for start in starts if start < last})
    path = travel(record)
    edges: list[float] = []
    for start, end in zip(starts, [*starts[1:], np.nextafter(last, np.inf)], strict=True):
        edge = start
        first = 4.0 * _interval_behind(record, start) if first_width is None else first_width
        while edge < end and len(edges) < LONGEST_GRID:
            edges.append(edge)
            width = min(widest, first + (ratio - 1.0) * (edge - start))
            edge = min(edge + width, _after_travel(*path, edge, largest_change))
    if len(edges) == LONGEST_GRID:
        raise _too_many_bins(record, "first_width, widest or largest_change")
    return np.array([*edges, np.nextafter(last, np.inf)])


def record_corners(record: WorkingRecord) -> FloatArray:
    """Return the coordinates at which the excitation turns."""
    tolerance = CORNER_FRACTION * record.excitation_range
    return corners(record.excitation_coordinate, record.excitation, tolerance, record.interval)


def _interval_behind(record: WorkingRecord, start: float) -> float:
    """Sampling interval after a corner if less than half the usual one, else the usual one."""
    behind = record.coordinate[np.searchsorted(record.coordinate, start) :][:NEXT_SAMPLES]
    usual = record.interval
    interval = usual_interval(behind) if behind.size > 1 else usual
    return interval if interval < 0.5 * usual else usual


def _too_many_bins(record: WorkingRecord, keys: str, count: str = "") -> UserError:
    return UserError(
        f"preparation of {record.row.name} ({record.row.protocol}), average: makes more than "
        f"{LONGEST_GRID} bins{count}; give a larger average.{keys}"
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


def nodes_of(place: FloatArray, weights: FloatArray, starts: IntArray, bends: BoolArray) -> Nodes:
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
    counts = [places.size for places in offsets]
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


@dataclass(frozen=True)
class Ringing:
    """A decaying oscillation: its period, its start, and its last visible turn [s]."""

    period: float
    start: float
    end: float


def ringing(record: WorkingRecord) -> Ringing | None:
    """Return the fastest ringing between corners of the excitation, or None.

    Turns of the response count if they are more than 2 % of its range, and ten times its noise,
    apart. At least a peak and a trough are needed; single outlying samples do not count. The
    turns must end, or lose half of their height, within the stretch. An oscillation that does
    not, such as mains hum, is no ringing.
    """
    time, response = record.coordinate[record.used], record.response[record.used]
    swing = least_swing(response)
    response = without_single_samples(response, swing)
    tolerance, interval = CORNER_FRACTION * record.excitation_range, usual_interval(time)
    inner = corners(record.excitation_coordinate, record.excitation, tolerance, interval)
    edges = [record.excitation_start(), *map(float, inner), np.nextafter(time[-1], np.inf)]
    ringings = []
    for start, end in pairwise(edges):
        inside = slice(*np.searchsorted(time, [start, end]))
        ringings.append(_of_stretch(time[inside], response[inside], swing))
    return min(filter(None, ringings), key=lambda rings: rings.period, default=None)


def _of_stretch(time: FloatArray, response: FloatArray, swing: float) -> Ringing | None:
    turns = np.array(_turns(response.tolist(), swing), dtype=np.intp)
    if turns.size < FEWEST_TURNS:
        return None
    heights = np.abs(np.diff(response[turns]))
    ended = time[turns[-1]] < time[0] + EARLY * (time[-1] - time[0])
    if not ended and heights[-1] > DECAYED * heights[0]:
        return None
    half = float(np.median(np.diff(time[turns[:FIRST_TURNS]])))
    return Ringing(2.0 * half, float(time[0]), float(time[turns[-1]]))


def _turns(values: list[float], swing: float) -> list[int]:
    """Return indices of peaks and troughs that differ by more than `swing` from what follows."""
    turns: list[int] = []
    high = low = 0
    direction = 0
    for index, value in enumerate(values):
        high = index if value > values[high] else high
        low = index if value < values[low] else low
        if direction >= 0 and values[high] - value > swing:
            turns += [high] if direction else []
            direction, low = -1, index
        elif direction <= 0 and value - values[low] > swing:
            turns += [low] if direction else []
            direction, high = 1, index
    return turns
