"""The highest point of a curve of each draw."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deabayes.experiment import FloatArray

POINTS = 401
CLOSER = np.linspace(0.0, 1.0, 21)
ROUNDS = 7
"""Each round leaves a tenth of the interval: 1e-7 of the first spacing in the end."""


def peak(
    curve: Callable[[FloatArray], FloatArray], highest: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where a curve on [0, highest] is highest, and its value there, each (W,).

    The best of an even grid is found first; around it the curve is taken to have one
    peak. A draw whose curve is not finite gives NaN.

    Parameters
    ----------
    curve : abscissae (W, P) -> values (W, P).
    highest : (W,).
    """
    low, high = np.zeros_like(highest), highest
    for fractions in (np.linspace(0.0, 1.0, POINTS), *(CLOSER,) * ROUNDS):
        places = low[:, None] + (high - low)[:, None] * fractions
        values = curve(places)
        best = np.argmax(values, axis=1)
        rows, last = np.arange(best.size), fractions.size - 1
        place, value = places[rows, best], values[rows, best]
        low, high = places[rows, np.maximum(best - 1, 0)], places[rows, np.minimum(best + 1, last)]
    return np.where(np.isfinite(value), place, np.nan), value
