"""Posterior intervals as columns of a table, and bands over a curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.fitted import Fitted

QUANTILES = (0.05, 0.95)


def interval(
    name: str, unit: str, draws: ArrayLike, value: float | None = None
) -> dict[str, float]:
    """`{name}_{unit}`, `{name}_q05`, `{name}_q95` of draws (S,).

    Parameters
    ----------
    unit : last word of the column; empty for a plain number.
    value : the number itself; the median of the draws by default. NaN draws are left out.
    """
    found = np.asarray(draws, dtype=float)
    found = found[np.isfinite(found)]
    low, high = np.quantile(found, QUANTILES) if found.size else (np.nan, np.nan)
    if value is None:
        value = float(np.median(found)) if found.size else np.nan
    column = f"{name}_{unit}" if unit else name
    return {column: float(value), f"{name}_q05": float(low), f"{name}_q95": float(high)}


def band(draws: FloatArray) -> FloatArray:
    """Lower bound, median and upper bound (3, N) of draws (S, N)."""
    return np.quantile(draws, [QUANTILES[0], 0.5, QUANTILES[1]], axis=0)


def labels(name: str, fitted: Fitted) -> dict[str, object]:
    """First columns of a row about a candidate."""
    return {"candidate": name, "order": fitted.system.order, "converged": fitted.converged}
