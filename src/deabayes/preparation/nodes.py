"""Where a model is evaluated to have its mean over the samples behind a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray, Nodes
from deabayes.preparation.working import IntArray

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
