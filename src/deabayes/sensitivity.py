"""Sobol' indices of a function of independent uniform numbers, with honest failures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from deabayes.experiment import FloatArray

CONFIDENCE = 0.95
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
    """Saltelli's points in the unit cube, (groups (d + 2), d); `groups` is a power of two."""
    from SALib.sample import sobol

    points: FloatArray = sobol.sample(
        _problem(dimension), groups, calc_second_order=False, seed=_seed(rng)
    )
    return points


def indices(values: FloatArray, dimension: int, rng: np.random.Generator) -> Indices | None:
    """Indices of the values (n,) at a design's points; NaN marks a point that failed.

    The estimators pair a group's points, so a group with a failed point is left out whole.
    What is left is no product design any more: keep its share small (see
    `Indices.left_out`), by asking about a region in which hardly any point fails.

    Returns
    -------
    None where there is nothing to explain: fewer than two groups, or one value throughout.
    """
    from SALib.analyze import sobol

    by_group = np.asarray(values, dtype=float).reshape(-1, dimension + 2)
    kept = by_group[np.all(np.isfinite(by_group), axis=1)]
    if len(kept) < 2 or np.ptp(kept) == 0.0:
        return None
    found = sobol.analyze(
        _problem(dimension),
        kept.ravel(),
        calc_second_order=False,
        num_resamples=RESAMPLES,
        conf_level=CONFIDENCE,
        seed=_seed(rng),
    )
    first, first_conf, total, total_conf = (
        np.asarray(found[name], dtype=float) for name in ("S1", "S1_conf", "ST", "ST_conf")
    )
    left_out = len(by_group) - len(kept)
    return Indices(first, first_conf, total, total_conf, len(by_group), left_out)


def _problem(dimension: int) -> dict[str, Any]:
    names = [f"u_{k}" for k in range(dimension)]
    return {"num_vars": dimension, "names": names, "bounds": [[0.0, 1.0]] * dimension}


def _seed(rng: np.random.Generator) -> int:
    """Not 0, which SALib takes for no seed."""
    return int(rng.integers(1, 2**31))
