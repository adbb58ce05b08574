"""Blocks of the records, and how well a candidate predicts each block from the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from deabayes.experiment import Experiment, FloatArray
from deabayes.posteriors.sensitivity import smoothed

Place = tuple[str, slice]
"""A block: the name of its record, and the slice of its points."""
FEWEST_INTERIOR = 3
"""With fewer interior blocks than this in all records, the blocks at the ends count too."""


@dataclass(frozen=True)
class BlockLoo:
    """Leave-one-block-out expected log predictive density.

    Attributes
    ----------
    terms : (B,), the contributions of the blocks, which are the same for every candidate of a
        study.
    k_hat : (B,), the Pareto shapes of the blocks' importance weights.
    names : where the blocks are.
    ends : (B,), whether a block is the first or the last of its record. Such a block is predicted
        from one side only: it measures extrapolation, not order.
    """

    terms: FloatArray
    k_hat: FloatArray
    names: tuple[str, ...] = ()
    ends: tuple[bool, ...] = ()

    @property
    def interior(self) -> NDArray[np.bool_]:
        """Which blocks decide, (B,): those inside their records, or all if these are too few."""
        inside = ~np.asarray(self.ends or [False] * self.terms.size, dtype=bool)
        return inside if inside.sum() >= FEWEST_INTERIOR else np.ones_like(inside)

    @property
    def elpd(self) -> float:
        """Sum of the terms of the blocks that decide."""
        return float(np.sum(self.terms[self.interior]))

    @property
    def se(self) -> float:
        """Standard error of `elpd`."""
        return standard_error(self.terms[self.interior])


def standard_error(terms: FloatArray) -> float:
    """Standard error of a sum of block terms."""
    return float(np.sqrt(terms.size * np.var(terms, ddof=1))) if terms.size > 1 else float("inf")


def block_edges(coordinate: FloatArray, length: float) -> NDArray[np.intp]:
    """First index of each block; a block is a contiguous stretch at least `length` long.

    With blocks of at least two correlation lengths, the neighbours of a left-out block say
    little about its noise (inference.md, Model order).
    """
    edges, start = [0], coordinate[0]
    for index, value in enumerate(coordinate):
        if value - start >= length and index > edges[-1]:
            edges.append(index)
            start = value
    if len(edges) > 2 and coordinate[-1] - coordinate[edges[-1]] < length / 2:
        edges.pop()
    return np.asarray(edges, dtype=np.intp)


def block_terms(pointwise: FloatArray, edges: NDArray[np.intp]) -> FloatArray:
    """Sum conditional log densities (S, N) over blocks: (S, B)."""
    return np.add.reduceat(pointwise, edges, axis=1)


def leave_one_block_out(
    terms: FloatArray, names: tuple[str, ...] = (), ends: tuple[bool, ...] = ()
) -> BlockLoo:
    """Estimate block-LOO by Pareto-smoothed importance sampling (Vehtari, Gelman & Gabry 2017).

    Draws of the full posterior have weights 1 / p(block | theta_s).

    Parameters
    ----------
    terms : (S, B) log p(block | points before it, theta_s).
    """
    weighed = [smoothed(-block) for block in terms.T]
    elpd = [
        logsumexp(weights + block) for (weights, _), block in zip(weighed, terms.T, strict=True)
    ]
    k_hat = np.asarray([shape for _, shape in weighed])
    return BlockLoo(np.asarray(elpd), k_hat, names, ends)


def block_ends(experiments: Mapping[str, Experiment], places: Sequence[Place]) -> tuple[bool, ...]:
    """Whether each block is the first or the last of its record."""
    return tuple(
        block.start == 0 or block.stop == experiments[name].coordinate.size
        for name, block in places
    )


def block_names(experiments: Mapping[str, Experiment], places: Sequence[Place]) -> tuple[str, ...]:
    """Describe where each block is, such as `the end of creep_2kV, time 0.8 to 1 s`."""

    def named(name: str, block: slice) -> str:
        experiment = experiments[name]
        at, unit = experiment.coordinate, experiment.coordinate_unit
        edge = "the beginning of " if block.start == 0 else ""
        edge = "the end of " if block.stop == at.size else edge
        extent = f"{at[block.start]:.3g} to {at[block.stop - 1]:.3g}"
        where = f"{edge}{name}, {experiment.coordinate_name} {extent}"
        return where if unit == "1" else f"{where} {unit}"

    return tuple(named(*place) for place in places)
