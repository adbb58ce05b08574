"""How well a candidate predicts each block of its records from the other blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from deabayes.experiment import Experiment, FloatArray
from deabayes.inference.blocks import Place
from deabayes.posteriors.sensitivity import smoothed

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
