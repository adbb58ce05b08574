"""Sobol' indices of a function of independent uniform numbers, with honest failures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray

HALF_WIDTH = 1.96
"""Of a 95 % interval, in standard deviations."""
RESAMPLES = 100


@dataclass(frozen=True)
class Indices:
    r"""Shares of the variance of Y, each (d,), with half-widths of their 95 % intervals.

    First order, S_i = V[E(Y | u_i)] / V(Y): what is explained by u_i alone; total,
    S_Ti = E[V(Y | u_not i)] / V(Y): what is left unexplained when u_i alone is unknown
    (Sobol' 1993; Homma & Saltelli 1996). Estimators: Saltelli et al. 2010, Table 2, (b)
    and (f). The half-widths bootstrap the groups of the design as if they were random;
    its points are spread more evenly than that, so they err on the wide side.

    Attributes
    ----------
    groups, left_out : groups of d + 2 points in the design, and those of them left out
        because a point failed.
    """

    first_order: FloatArray
    first_order_conf: FloatArray
    total: FloatArray
    total_conf: FloatArray
    groups: int
    left_out: int


def design(dimension: int, groups: int, rng: np.random.Generator) -> FloatArray:
    """Saltelli's points in the unit cube, (groups (d + 2), d); `groups` is a power of two.

    A group is a point A, then A with one coordinate after another from a point B, then B.
    """
    from scipy.stats import qmc

    found = qmc.Sobol(2 * dimension, scramble=True, rng=rng).random(groups)
    a, b = found[:, None, :dimension], found[:, None, dimension:]
    mixed = np.where(np.eye(dimension, dtype=bool), b, a)
    return np.concatenate([a, mixed, b], axis=1).reshape(-1, dimension)


def indices(values: FloatArray, dimension: int, rng: np.random.Generator) -> Indices | None:
    """Indices of the values (n,) at a design's points; NaN marks a point that failed.

    The estimators pair a group's points, so a group with a failed point is left out whole.
    What is left is no product design any more: keep its share small (see
    `Indices.left_out`), by asking about a region in which hardly any point fails.

    Returns
    -------
    None where there is nothing to explain: fewer than two groups, or one value throughout.
    """
    by_group = np.asarray(values, dtype=float).reshape(-1, dimension + 2)
    kept = by_group[np.all(np.isfinite(by_group), axis=1)]
    if len(kept) < 2 or np.ptp(kept) == 0.0:
        return None
    centred = (kept - kept.mean()) / kept.std()
    first, total = _estimates(centred, np.ones((1, len(kept))))
    picked = rng.integers(len(kept), size=(RESAMPLES, len(kept)))
    counts = np.array([np.bincount(row, minlength=len(kept)) for row in picked], dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):  # of a resample with one value throughout
        spread = [HALF_WIDTH * each.std(axis=0, ddof=1) for each in _estimates(centred, counts)]
    left_out = len(by_group) - len(kept)
    return Indices(first[0], spread[0], total[0], spread[1], len(by_group), left_out)


def _estimates(values: FloatArray, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First-order and total indices (R, d) of groups (G, d + 2), each counted so often (R, G)."""
    a, mixed, b = values[:, :1], values[:, 1:-1], values[:, -1:]
    shares = counts / counts.sum(axis=1, keepdims=True)
    mean, square = (shares @ (0.5 * (a**power + b**power)) for power in (1, 2))
    variance = square - mean**2
    return (
        shares @ (b * (mixed - a)) / variance,
        shares @ (0.5 * (a - mixed) ** 2) / variance,
    )
