"""Blocks of the records' points, which are left out together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import Experiment, FloatArray
from deabayes.inference.log_posterior import LogPosterior

Place = tuple[str, slice]
"""A block: the name of its record, and the slice of its points."""
Edges = Mapping[str, NDArray[np.intp]]
"""First index of each block, by record."""
FEWEST_BLOCKS = 10
DRAWS_AT_ONCE = 1000


def block_edges(coordinate: FloatArray, length: float) -> NDArray[np.intp]:
    """First index of each block; a block is a contiguous stretch at least `length` long.

    With blocks of at least two correlation lengths, the neighbours of a left-out block say
    little about its noise (docs/statistics.md, Model order).
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


def block_log_likelihood(target: LogPosterior, theta: FloatArray, edges: Edges) -> FloatArray:
    """log p(block | points before it, theta) of all blocks, (S, B), in the order of the records.

    Parameters
    ----------
    theta : (S, d) draws.
    """
    parts = np.array_split(theta, max(-(-len(theta) // DRAWS_AT_ONCE), 1))
    return np.concatenate([_block_log_likelihood(target, part, edges) for part in parts])


def _block_log_likelihood(target: LogPosterior, theta: FloatArray, edges: Edges) -> FloatArray:
    pointwise = target.pointwise_log_likelihood(theta)
    names = [r.experiment.name for r in target.records]
    return np.concatenate([block_terms(pointwise[name], edges[name]) for name in names], axis=1)


def block_places(target: LogPosterior, edges: Edges) -> list[Place]:
    """Return the record's name and the slice of points of every block."""
    return [
        (r.experiment.name, slice(*ends))
        for r in target.records
        for ends in pairwise((*edges[r.experiment.name], r.experiment.coordinate.size))
    ]


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
