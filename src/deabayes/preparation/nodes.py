"""Where a model is evaluated to have its mean over the samples behind a point."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import FloatArray, Nodes
from deabayes.preparation.working import IntArray

COUNT = 3
"""Nodes of a point: the mean of a polynomial of degree 5 is exact."""


def gauss_nodes(place: FloatArray, weights: FloatArray, starts: IntArray) -> Nodes:
    """The Gauss rule of the samples of each bin (Golub & Welsch 1969, Math. Comp. 23, 221).

    Orthogonal polynomials of a bin's samples follow from p_0 = 1 by
    p_(k+1) = (x - a_k) p_k - b_k p_(k-1), a_k = <x p_k^2> / <p_k^2>, b_k = <p_k^2> / <p_(k-1)^2>,
    with <.> the mean over the samples. The nodes are the eigenvalues of the matrix with diagonal a
    and off-diagonal sqrt(b), their shares the squares of the eigenvectors' first components. A bin
    of one or two samples has these as nodes, others have share 0.

    Parameters
    ----------
    place : (M,) of the samples, from their bin's mean on.
    weights : (M,) of the samples.
    starts : (N,) first sample of each bin.
    """
    bins = np.repeat(np.arange(starts.size), np.diff([*starts, place.size]))
    width = np.maximum.reduceat(np.abs(place), starts)
    x = place / np.where(width > 0.0, width, 1.0)[bins]
    total = np.add.reduceat(weights, starts)
    before, now = np.zeros_like(x), np.ones_like(x)
    matrix = np.zeros((starts.size, COUNT, COUNT))
    norm = np.ones(starts.size)
    for k in range(COUNT):
        square = weights * now**2
        last, norm = norm, np.add.reduceat(square, starts) / total
        some = norm > 1e-14 * last
        scale = np.where(some, norm, 1.0)
        a = np.where(some, np.add.reduceat(x * square, starts) / total / scale, 0.0)
        b = np.where(some, norm / np.where(last > 0.0, last, 1.0), 0.0)
        matrix[:, k, k] = a
        if k:
            matrix[:, k, k - 1] = matrix[:, k - 1, k] = np.sqrt(b)
        before, now = now, (x - a[bins]) * now - (b[bins] * before if k else 0.0)
    nodes, vectors = np.linalg.eigh(matrix)
    return Nodes(width[:, None] * nodes, vectors[:, 0] ** 2)
