"""Excitations whose samples are too far apart for straight lines between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from deabayes.experiment import Excitation, FloatArray

LARGEST_MISS = 0.002
"""Of the excitation's range, root mean square: a sine of 28 samples a period."""
FEWEST_SAMPLES = 16
LAGS = (1, 3)


def missed_by_lines(excitation: Excitation) -> float:
    r"""What straight lines between samples miss of a curved excitation, rms over its range.

    A sample is off the line between its neighbours by d_k, and half way between two samples of a
    smooth curve a line misses d/4. Of such a curve d_k d_{k+m} is positive for small m. A jump, a
    corner and a monitor's noise count for nothing: their mean product is negative or none with
    neighbours (m = 1), and none beyond the reach of a sample's own noise (m = 3).
    """
    at, values = excitation.coordinate, excitation.values
    extent = float(np.ptp(values))
    if values.size < FEWEST_SAMPLES or extent == 0.0:
        return 0.0
    share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    off = values[1:-1] - (1.0 - share) * values[:-2] - share * values[2:]
    together = max(_surely(off[lag:] * off[:-lag]) for lag in LAGS)
    return 0.25 * float(np.sqrt(together)) / extent


def _surely(products: FloatArray) -> float:
    """Their mean where it is more than three standard errors above zero, else zero."""
    mean, error = float(np.mean(products)), float(np.std(products)) / np.sqrt(products.size)
    return mean if mean > 3.0 * error else 0.0


def too_coarse(excitation: Excitation) -> str | None:
    """What there is to say of an excitation that lines follow badly; None where they do."""
    missed = missed_by_lines(excitation) if excitation.in_time else 0.0
    if missed <= LARGEST_MISS:
        return None
    return (
        f"between its samples the {excitation.name} is taken for straight lines, which miss "
        f"{100 * missed:.2g} % of its range (rms): predicted amplitudes come out too small; log "
        "the drive at 30 samples a period and more"
    )
