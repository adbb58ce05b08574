"""Modes of a posterior, and whether independent runs give them the same weight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling import chains
from deabayes.sampling.gates import Failed
from deabayes.sampling.mixture import Mixture, fit

if TYPE_CHECKING:
    import pandas as pd


def mode_shares(
    draws: FloatArray, components: int = 8, sample: int = 6000
) -> tuple[pd.DataFrame, list[Failed]]:
    """Share of every run's draws (E, S, W, d) in each mode, and where the runs disagree.

    A mixture is fitted to the pooled draws; components that share more than one per cent
    of their draws make up one mode. Shares disagree when one is further from the pooled
    share than four standard errors and half a per cent, or less than a fifth of a pooled
    share above one per cent: a mode that this run has missed. So may those of the components
    that make up a mode: of a small one beside a large one, or of runs with one distribution
    per coordinate and another of all together.
    """
    import pandas as pd

    runs, steps, _, dimension = draws.shape
    flat = draws.reshape(-1, dimension)
    flat = flat[chains.thin_evenly(len(flat), sample)]
    mixture = fit(flat, components, np.random.default_rng(0))
    kept = draws[:, chains.thin_evenly(steps, 200)]
    cell = mixture.component_log_density(kept.reshape(-1, dimension)).argmax(axis=1)
    cell, joined = cell.reshape(kept.shape[:3]), _modes(mixture, flat)
    mode = joined[cell]
    labels = [f"run {run}" for run in range(1, runs + 1)]
    inside = [(mode == index).astype(float) for index in range(mode.max() + 1)]
    inside = sorted((each for each in inside if each.any()), key=lambda each: -each.mean())
    table = pd.DataFrame([each.mean(axis=(1, 2)) for each in inside], columns=labels)
    table.index = pd.RangeIndex(1, len(table) + 1, name="mode")
    failed: list[Failed] = []
    for index, each in enumerate(inside, start=1):
        failed += _shares(f"mode {index}", each)
    parts = [part for part in range(len(mixture.weights)) if np.sum(joined == joined[part]) > 1]
    for part in parts if not failed else ():
        failed += _shares(f"part {part + 1} of a mode", (cell == part).astype(float))
    return table, failed


def _shares(name: str, inside: FloatArray) -> list[Failed]:
    pooled, shares = inside.mean(), inside.mean(axis=(1, 2))
    sizes = [chains.ess_bulk(run[None]) for run in inside if 0 < run.mean() < 1]
    error = np.sqrt(pooled * (1 - pooled) / np.median(sizes)) if sizes else 0.0
    missed = (shares < pooled / 5) & (pooled > 0.01)
    return [
        Failed(
            "modes",
            name,
            f"it holds {pooled:.1%} of all draws but {shares[run]:.1%} of run {run + 1}: "
            "the independent runs weigh the modes differently",
            float(abs(shares[run] - pooled)),
        )
        for run in np.flatnonzero((np.abs(shares - pooled) > 4 * error + 0.005) | missed)
    ]


def _modes(mixture: Mixture, z: FloatArray, overlap: float = 0.01) -> NDArray[np.intp]:
    """Mode (K,) of every component: joined when they share some of the draws z (N, d)."""
    terms = mixture.component_log_density(z)
    member = np.exp(terms - terms.max(axis=1, keepdims=True))
    member /= member.sum(axis=1, keepdims=True)
    mode = np.arange(len(mixture.weights))
    for first in range(len(mode)):
        for second in range(first):
            shared = np.minimum(member[:, first], member[:, second]).sum()
            if shared > overlap * min(member[:, first].sum(), member[:, second].sum()):
                mode[mode == mode[first]] = mode[second]
    return np.unique(mode, return_inverse=True)[1]
