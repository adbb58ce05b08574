"""Posterior intervals as columns of a table, and bands over a curve."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import FloatArray
from deabayes.posteriors.fitted import Fitted

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


def beside(rows: Sequence[Mapping[str, object]], unit: str = "kV") -> list[dict[str, object]]:
    """Rows of one candidate and frequency joined, columns told apart by their `voltage_{unit}`.

    `x_mm` at 5 kV becomes `x_5kV_mm`, `x_q05` becomes `x_5kV_q05`; lowest frequency and
    highest voltage first. A voltage that comes again at its frequency stands in a row of its
    own below, in the order given.
    """
    same = ("candidate", "order", "converged", "frequency_Hz")
    voltage = f"voltage_{unit}"
    candidates = list(dict.fromkeys(row["candidate"] for row in rows))

    def place(row: Mapping[str, object]) -> tuple[float, ...]:
        frequency, volts = float(str(row["frequency_Hz"])), float(str(row[voltage]))
        return candidates.index(row["candidate"]), frequency, -volts

    joined: dict[tuple[object, ...], dict[str, object]] = {}
    times: Counter[tuple[object, ...]] = Counter()
    for row in sorted(rows, key=place):
        key = tuple(row[name] for name in same)
        told = f"{float(str(row[voltage])):.3g}{unit}"
        times[*key, told] += 1
        one = joined.setdefault((*key, times[*key, told]), dict(zip(same, key, strict=True)))
        one |= {
            _told(column, told): value
            for column, value in row.items()
            if column not in (*same, voltage)
        }
    return list(joined.values())


def _told(column: str, told: str) -> str:
    name, _, last = column.rpartition("_")
    return f"{name}_{told}_{last}" if name else f"{column}_{told}"
